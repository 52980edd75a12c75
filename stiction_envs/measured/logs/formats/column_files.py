"""Columns, or matrices ``q``, ``tau``, … with ``t``: NumPy's archives and arrays, Parquet tables.

NumPy takes the memory of an array before it reads it, so a header that lies costs nothing: the
system gives memory when it is written to, and the file ends before.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.formats.base import (
    Arrays,
    ColumnFile,
    check_bytes,
    check_size,
    damaged,
)

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile


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


class Parquet(ColumnFile):
    """A Parquet table, a channel of a joint in a column."""

    ends: ClassVar = (".parquet",)

    def columns(self, where: str) -> Arrays:
        """Read the columns."""
        wrong = "damaged or no Parquet file: expected a table of numbers"
        with opened(where, where, wrong) as file:
            names = file.schema_arrow.names
            check_size(where, file.metadata.num_rows, (len(names) + 1) // 2)
            table = file.read()
            # Columns by place: names may be there twice.
            columns = [(n, table.column(i).to_numpy()) for i, n in enumerate(names)]
        repeated = [n for i, (n, _) in enumerate(columns) if n in dict(columns[:i])]
        if repeated:
            raise StictionError(f"{where}: column {repeated[0]!r} is there twice: expected one")
        return dict(columns)


@contextmanager
def opened(where: str, path: str | Path, wrong: str) -> Iterator[ParquetFile]:
    """Open a file of a log; any failure while it is open is one error: what is ``wrong``."""
    try:
        from pyarrow import parquet  # here: few logs need it, and it takes a moment
    except ImportError:
        raise missing_extra(f"{where}: reading .parquet", "pyarrow", "parquet") from None
    refuse_pointer(path)
    with damaged(f"{path}: {wrong}"), parquet.ParquetFile(path) as file:
        yield file
