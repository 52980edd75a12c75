"""Parquet tables of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.formats.base import Arrays, ColumnFile, check_size, damaged

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile


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
