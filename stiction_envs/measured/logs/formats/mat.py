"""MATLAB's files: variables ``t``, ``q`` (T, n), ``tau``, …, also as fields of structures.

Versions up to 7 are read by SciPy, version 7.3, which is HDF5, by h5py (extra ``mat``). A matrix
with a joint in each row is turned. Objects (``timeseries``, ``table``) hold no plain numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.measured.logs.formats.base import MOST_BYTES, Arrays, ColumnFile

HDF5 = b"\x89HDF\r\n\x1a\n"
"""How HDF5 begins, behind MATLAB's own 512 bytes. Source: its specification."""
MOST_PACKED = 2**28
"""Most bytes of a file of version 7, whose variables are compressed; assumed."""
MOST_JOINTS = 100
"""Shorter sides of matrices are joints; assumed."""
Matrix = np.ndarray[Any, Any]


class MatFile(ColumnFile):
    """What MATLAB's ``save`` writes."""

    ends: ClassVar = (".mat",)

    def columns(self, where: str) -> Arrays:
        """Read the variables that hold numbers."""
        try:
            with open(where, "rb") as file:
                start = file.read(512 + len(HDF5))
            read = _hdf5 if HDF5 in (start[: len(HDF5)], start[512:]) else _version_5
            found = {name: _upright(x) for name, x in read(where)}
        except StictionError:
            raise
        except Exception:
            # damaged files raise almost anything
            raise StictionError(
                f"{where}: damaged or no MATLAB file: expected what MATLAB's save writes"
            ) from None
        if not found:
            raise StictionError(
                f"{where}: no matrices of numbers: expected t, q, tau; no objects (timeseries)"
            )
        if len({name.partition(".")[0] for name in found}) == 1:
            # one structure around all says nothing
            found = {name.partition(".")[2] or name: x for name, x in found.items()}
        return found


def _version_5(where: str) -> Iterator[tuple[str, Matrix]]:
    from scipy.io import loadmat, whosmat  # here: few logs need it, and it takes a moment

    _check_bytes(where, Path(where).stat().st_size, MOST_PACKED)
    _check_bytes(where, sum(8 * math.prod(shape) for _, shape, _ in whosmat(where)))
    for name, value in loadmat(where).items():
        yield from _fields(name, value)


def _fields(name: str, value: object) -> Iterator[tuple[str, Matrix]]:
    """Yield the matrices of a variable, those of its fields by their path."""
    if not isinstance(value, np.ndarray) or value.ndim != 2:
        return
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _fields(f"{name}.{field}", value[field].flat[0])
    elif value.dtype.kind in "fiu":
        yield name, value


def _hdf5(where: str) -> Iterator[tuple[str, Matrix]]:
    try:
        import h5py  # here: an extra
    except ImportError:
        raise missing_extra(f"{where}: reading .mat of version 7.3", "h5py", "mat") from None
    found: dict[str, Any] = {}

    def note(name: str, item: Any) -> None:
        # what cells refer to is kept under #refs#; text is numbers of letters
        is_matrix = isinstance(item, h5py.Dataset) and item.ndim == 2 and item.dtype.kind in "fiu"
        if is_matrix and name[0] != "#" and item.attrs.get("MATLAB_class") != b"char":
            found[name.replace("/", ".")] = item

    with h5py.File(where, "r") as file:
        file.visititems(note)
        _check_bytes(where, sum(int(item.nbytes) for item in found.values()))
        yield from ((name, item[()].T) for name, item in found.items())


def _upright(value: Matrix) -> Matrix:
    """Return a column (T,), or a matrix with a sample in each row."""
    if 1 in value.shape:
        return value.reshape(-1)
    return value.T if value.shape[0] < min(value.shape[1], MOST_JOINTS) else value


def _check_bytes(where: str, size: int, most: int = MOST_BYTES) -> None:
    if size > most:
        raise StictionError(f"{where}: over {most >> 20} MiB: expected a shorter log")
