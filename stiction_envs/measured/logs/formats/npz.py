"""NumPy archives: columns, or matrices ``q``, ``tau``, … with ``t``."""

from __future__ import annotations

import zipfile
from typing import IO, ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.formats.base import MOST_BYTES, Arrays, ColumnFile


class NumpyArchive(ColumnFile):
    """What `numpy.savez` writes."""

    ends: ClassVar = (".npz",)

    def columns(self, where: str) -> Arrays:
        """Read the arrays."""
        arrays: Arrays = {}
        member = ""
        try:
            with zipfile.ZipFile(where) as archive:
                if sum(info.file_size for info in archive.infolist()) > MOST_BYTES:
                    raise StictionError(
                        f"{where}: over {MOST_BYTES >> 20} MiB unpacked: expected a shorter log"
                    )
                for info in archive.infolist():
                    member = info.filename
                    if not member.endswith(".npy"):
                        continue
                    with archive.open(info) as file:
                        _check_npy(where, file, info)
                    with archive.open(info) as file:
                        arrays[member.removesuffix(".npy")] = np.lib.format.read_array(
                            file, allow_pickle=False
                        )
        except StictionError:
            raise
        except Exception:
            # Damaged archives raise almost anything, from zlib.error to SyntaxError.
            inside = f", {member}" if member else ""
            raise StictionError(
                f"{where}{inside}: damaged or no NumPy archive: expected what numpy.savez writes"
            ) from None
        return arrays


def _check_npy(where: str, file: IO[bytes], info: zipfile.ZipInfo) -> None:
    """What the array says of itself must fit into its file, before any memory is taken for it."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    if dtype.hasobject:
        raise StictionError(
            f"{where}, {info.filename}: holds Python objects: expected arrays of numbers"
        )
    size = dtype.itemsize
    for length in shape:
        size *= length
    if size > info.file_size:
        raise StictionError(
            f"{where}, {info.filename}: shape {shape} does not fit into its "
            f"{info.file_size} bytes: expected what numpy.savez writes"
        )
