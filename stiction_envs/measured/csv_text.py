"""CSV text with errors that name file, line, column and what is expected."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from numbers import Integral
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError, opening, unknown
from stiction_envs.measured.dialect import dialect_of, encoding_of, header_in, refuse_pointer
from stiction_envs.reporting.atomic import write_text_atomic

FIRST_BYTES = 65_536
"""Bytes of a file in which its header must end; assumed."""
Cells = Sequence[Any]
"""Cells of a row: texts, and numbers as `float` takes them."""


class Line:
    """One line of a table: its fields by column name, and where it is."""

    def __init__(self, where: str, fields: dict[str, str]) -> None:
        self.where = where
        """``path, line number``, the beginning of every message about this line."""
        self.fields = fields

    def error(self, message: str) -> StictionError:
        """An error at this line."""
        return StictionError(f"{self.where}: {message}")

    @contextmanager
    def named(self) -> Iterator[None]:
        """Put this line before the message of an error."""
        try:
            yield
        except StictionError as error:
            raise self.error(str(error)) from None

    def name(self, column: str, expected: Sequence[str]) -> str:
        """The field as one of the ``expected`` names."""
        value = self.fields[column]
        if value not in expected:
            raise self.error(str(unknown(column, value, expected)))
        return value

    def text(self, column: str) -> str:
        """The field as text that is not empty."""
        if not self.fields[column]:
            raise self.error(f"{column} is empty: expected any name")
        return self.fields[column]

    def number(
        self,
        column: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        nan: bool = False,
    ) -> float:
        """The field as a finite number from ``low`` (or NaN if ``nan``).

        Args:
            column: name.
            default: value of a column that is missing.
            low: least number.
            nan: whether NaN passes, which is an unknown number.
        """
        if default is not None and column not in self.fields:
            return default
        raw = self.fields[column]
        try:
            # Python's own 1_000 is no number anywhere else.
            value = float("" if "_" in raw else raw)
        except ValueError:
            raise self.error(f"{column} is {raw!r}: expected a number") from None
        if not (math.isfinite(value) or (nan and math.isnan(value))):
            raise self.error(f"{column} is {raw!r}: expected a finite number")
        if value < low:
            raise self.error(f"{column} is {value}: expected >= {low:g}")
        return value

    def whole(self, column: str, low: int, high: int | None = None) -> int:
        """The field as a whole number in ``low`` … ``high``."""
        raw = self.fields[column]
        expected = f"a whole number from {low}" + ("" if high is None else f" to {high}")
        try:
            value = int("" if "_" in raw else raw)
        except ValueError:
            raise self.error(f"{column} is {raw!r}: expected {expected}") from None
        if value < low or (high is not None and value > high):
            raise self.error(f"{column} is {value}: expected {expected}")
        return value


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file in UTF-8 or UTF-16, with line ends as they are."""
    refuse_pointer(path)
    try:
        with opening(path, "a readable CSV file"):
            data = Path(path).read_bytes()
        return data.decode(encoding_of(data))
    except UnicodeDecodeError as error:
        raise StictionError(
            f"{path}: byte {error.start} is not UTF-8: expected CSV text in UTF-8"
        ) from None


def read_lines(
    path: str | os.PathLike[str], required: Sequence[str], optional: Sequence[str] = ()
) -> list[Line]:
    """Lines of a comma-separated table whose header names every required column, in any order."""
    return parse_lines(path, read_text(path), required, optional)


def parse_lines(
    path: str | os.PathLike[str], text: str, required: Sequence[str], optional: Sequence[str] = ()
) -> list[Line]:
    """Parse text as `read_lines` does a file; messages begin with ``path``."""
    lines: list[Line] = []
    header: list[str] | None = None
    first, _, rest = text.lstrip().partition("\n")
    dialect = dialect_of(first, rest.partition("\n")[0])
    between = "," if dialect.delimiter == " " else dialect.delimiter
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=between)
    try:
        for cells in reader:
            row = [cell.strip() for cell in cells]
            if not any(row) and len(row) <= 1:
                continue
            if header is None:
                header = row
                check_columns(path, header, required, optional)
                continue
            if dialect.decimal_comma:
                row = [cell.replace(",", ".") for cell in row]
            where = f"{path}, line {reader.line_num}"
            if len(row) != len(header):
                raise StictionError(
                    f"{where}: {len(row)} values: expected one for each of {', '.join(header)}"
                )
            lines.append(Line(where, dict(zip(header, row, strict=True))))
    except csv.Error as error:
        raise StictionError(
            f"{path}, line {reader.line_num}: {error}: expected comma-separated text"
        ) from None
    if header is None:
        raise StictionError(f"{path}: empty file: expected a header {','.join(required)} and rows")
    if not lines:
        raise StictionError(f"{path}: no rows below the header: expected one or more")
    return lines


def header_of(path: str | os.PathLike[str]) -> list[str]:
    """Columns of a CSV; none if it is empty or cannot be read."""
    start = b""
    with suppress(OSError), open(path, "rb") as file:
        start = file.read(FIRST_BYTES)
    text = start.decode(encoding_of(start), errors="replace")
    lines = iter(text.splitlines())
    header = header_in(lines)[0].strip()
    return dialect_of(header, next(lines, "")).names(header)


def write_lines(path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Cells]) -> None:
    """Write a table at once; floats by ``repr``, so that they read back bit for bit."""
    write_text_atomic(path, table_text(header, rows))


def table_text(header: Sequence[str], rows: Iterable[Cells]) -> str:
    """Return the text of a table, as `write_lines` writes it."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([x if isinstance(x, str | Integral) else repr(float(x)) for x in row])
    return out.getvalue()


def check_columns(
    path: str | os.PathLike[str],
    header: Sequence[str],
    required: Sequence[str],
    optional: Sequence[str],
) -> None:
    """Raise if a ``header`` lacks a required column, or repeats one, or has an unknown one."""
    expected = f"expected {','.join(required)}"
    if optional:
        expected += f" with optional {','.join(optional)}"
    missing = [c for c in required if c not in header]
    extra = [c for c in header if c not in (*required, *optional)]
    twice = [c for c in header if header.count(c) > 1]
    for what, names in (("missing", missing), ("unknown", extra), ("repeated", twice)):
        if names:
            shown = ", ".join(repr(n) for n in dict.fromkeys(names))
            raise StictionError(f"{path}: {what} column {shown}: {expected}")
