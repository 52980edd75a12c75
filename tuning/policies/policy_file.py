"""A zip of JSON and numpy arrays that is safe to open: nothing in it is run.

Arrays are read by their header, never unpickled, and sizes are checked before unpacking. The same
content gives the same bytes.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.reporting.json_text import to_text
from tuning.policies.settings import FileSettings, policy_settings

CARD = "policy.json"
"""The entry that describes the file."""
Array = NDArray[np.floating]
KINDS = ("<f4", "<f8")
"""Types that the numbers of an array may have."""
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date of the zip format
_SB3 = {"_stable_baselines3_version", "policy.pth", "data"}


def write_archive(path: Path, card: Mapping[str, object], arrays: Mapping[str, Array]) -> None:
    """Write a card and arrays of float32 or float64 in one step."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(zipfile.ZipInfo(CARD, _EPOCH), to_text(card) + "\n")
        for name, array in arrays.items():
            part = io.BytesIO()
            np.lib.format.write_array(part, np.ascontiguousarray(array), allow_pickle=False)
            file.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), part.getvalue())
    write_bytes_atomic(path, out.getvalue())


def read_archive(path: Path) -> tuple[dict[str, object], dict[str, Array]]:
    """Return card and arrays (new) of a file from any source.

    Raises:
        StictionError: no such file, Stable-Baselines3's own zip, or anything that is not JSON and
            arrays of finite numbers within the size that is allowed.
    """
    limits = policy_settings().file
    try:
        with zipfile.ZipFile(path) as file:
            _check_entries(path, file, limits)
            card = _read_card(path, _unpacked(file, CARD))
            names = [n for n in file.namelist() if n != CARD]
            arrays = {
                n.removesuffix(".npy"): _read_array(path, n, _unpacked(file, n)) for n in names
            }
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise StictionError(f"{path}: {reason}: expected a policy.zip") from None
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise StictionError(f"{path}: not a policy.zip: {error}") from None
    return card, arrays


def _check_entries(path: Path, file: zipfile.ZipFile, limits: FileSettings) -> None:
    entries = file.infolist()
    names = [e.filename for e in entries]
    if _SB3 & set(names):
        raise StictionError(
            f"{path}: Stable-Baselines3's zip holds pickled code and is not opened: expected a "
            "policy.zip of `stiction train`, or what tuning.policies.algorithms.export makes of a "
            "model of your own"
        )
    if len(names) > limits.most_entries or len(set(names)) < len(names):
        raise StictionError(
            f"{path}: {len(names)} entries: expected at most {limits.most_entries}, no name twice"
        )
    # zipfile unpacks no more of an entry than the size that it claims
    if (size := sum(e.file_size for e in entries)) > limits.most_bytes:
        raise StictionError(f"{path}: {size} bytes unpacked: expected at most {limits.most_bytes}")
    if CARD not in names:
        raise StictionError(f"{path}: no {CARD} in it: expected a policy.zip of `stiction train`")
    for name in names:
        if name != CARD and not (name.endswith(".npy") and name[:-4].isidentifier()):
            raise StictionError(f"{path}: {name!r} in it: expected {CARD} and .npy arrays alone")


def _unpacked(file: zipfile.ZipFile, name: str) -> bytes:
    with file.open(name) as entry:
        return entry.read(file.getinfo(name).file_size)


def _read_card(path: Path, data: bytes) -> dict[str, object]:
    try:
        card = json.loads(data.decode())
    except (ValueError, RecursionError) as error:
        raise StictionError(f"{path}: {CARD}: not JSON: {error}") from None
    if not isinstance(card, dict):
        raise StictionError(f"{path}: {CARD}: expected an object")
    return card


def _read_array(path: Path, name: str, data: bytes) -> Array:
    """Return an array by its header: `numpy.load` would allocate whatever size that claims."""
    part = io.BytesIO(data)
    expected = "a numpy array of float32 or float64 in order of rows"
    try:
        version = np.lib.format.read_magic(part)
        if version != (1, 0):
            raise ValueError(f"format {version}")
        shape, columns, kind = np.lib.format.read_array_header_1_0(part)
    except ValueError as error:
        raise StictionError(f"{path}: {name}: {error}: expected {expected}") from None
    if kind.hasobject:
        raise StictionError(f"{path}: {name}: pickled objects are not opened: expected {expected}")
    if kind.str not in KINDS or (columns and len(shape) > 1):
        raise StictionError(f"{path}: {name}: {kind} in shape {shape}: expected {expected}")
    rest = data[part.tell() :]
    if math.prod(shape) * kind.itemsize != len(rest) or min(shape, default=1) < 0:
        raise StictionError(f"{path}: {name}: {len(rest)} bytes do not fit shape {shape}")
    out: Array = np.frombuffer(rest, kind).reshape(shape).copy()
    if not np.isfinite(out).all():
        raise StictionError(f"{path}: {name}: holds numbers that are not finite")
    return out
