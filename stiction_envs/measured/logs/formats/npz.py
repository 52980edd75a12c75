"""NumPy archives: columns, or matrices ``q``, ``tau``, … with ``t``; and arrays of all columns."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import IO, ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.formats.base import (
    MOST_BYTES,
    Arrays,
    ColumnFile,
    check_bytes,
    damaged,
)


class NumpyArchive(ColumnFile):
    """File that `numpy.savez` writes."""

    ends: ClassVar = (".npz",)

    def columns(self, where: str) -> Arrays:
        """Read the arrays."""
        arrays: Arrays = {}
        expected = "damaged or no NumPy archive: expected what numpy.savez writes"
        with damaged(f"{where}: {expected}"), zipfile.ZipFile(where) as archive:
            check_bytes(where, sum(info.file_size for info in archive.infolist()))
            for info in archive.infolist():
                member = info.filename
                if not member.endswith(".npy"):
                    continue
                with archive.open(info) as file:
                    _check_npy(f"{where}, {member}", file, info.file_size)
                with archive.open(info) as file:
                    array = np.lib.format.read_array(file, allow_pickle=False)
                arrays[member.removesuffix(".npy")] = array
        return arrays


class NumpyArray(ColumnFile):
    """File of `numpy.save`: columns with names of fields, or a matrix (T, k) without names."""

    ends: ClassVar = (".npy",)

    def columns(self, where: str) -> Arrays:
        """Read the array."""
        expected = "damaged or no NumPy array: expected what numpy.save writes"
        with damaged(f"{where}: {expected}"), open(where, "rb") as file:
            _check_npy(where, file, Path(where).stat().st_size)
            file.seek(0)
            array = np.lib.format.read_array(file, allow_pickle=False)
        if array.dtype.names:
            return {name: array[name] for name in array.dtype.names}
        if array.ndim != 2:
            raise StictionError(
                f"{where}: shape {array.shape}: expected (T, k), a row for each sample"
            )
        return {"": array}


def _check_npy(where: str, file: IO[bytes], size: int) -> None:
    """Check that an array's header fits into its ``size`` before any memory is taken for it."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    if dtype.hasobject:
        raise StictionError(f"{where}: holds Python objects: expected arrays of numbers")
    claimed = dtype.itemsize
    for length in shape:
        claimed *= length
    if claimed > min(size, MOST_BYTES):
        raise StictionError(
            f"{where}: shape {shape} does not fit into its {size} bytes: expected what NumPy writes"
        )
