"""NumPy archives: columns, or matrices ``q``, ``tau``, … with ``t``; and arrays of all columns.

NumPy takes the memory of an array before it reads it, so a header that lies costs nothing: the
system gives memory when it is written to, and the file ends before.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.formats.base import Arrays, ColumnFile, check_bytes, damaged


class NumpyArchive(ColumnFile):
    """File that `numpy.savez` writes."""

    ends: ClassVar = (".npz",)

    def columns(self, where: str) -> Arrays:
        """Read the arrays."""
        expected = "damaged or no NumPy archive: expected numbers, as numpy.savez writes them"
        with damaged(f"{where}: {expected}"), np.load(where) as archive:
            check_bytes(where, sum(info.file_size for info in archive.zip.infolist()))
            return {k: x for k, x in archive.items() if isinstance(x, np.ndarray)}


class NumpyArray(ColumnFile):
    """File of `numpy.save`: columns with names of fields, or a matrix (T, k) without names."""

    ends: ClassVar = (".npy",)

    def columns(self, where: str) -> Arrays:
        """Read the array."""
        expected = "damaged or no NumPy array: expected numbers, as numpy.save writes them"
        with damaged(f"{where}: {expected}"):
            array = np.load(where, mmap_mode="r")
        if array.dtype.names:
            return {name: array[name] for name in array.dtype.names}
        if array.ndim != 2:
            raise StictionError(
                f"{where}: shape {array.shape}: expected (T, k), a row for each sample"
            )
        return {"": array}
