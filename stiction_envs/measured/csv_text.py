"""Text tables: how people write them, and errors that name file, line, column and what is expected.

Excel writes semicolons and decimal commas in most of Europe, and "Unicode text" as UTF-16 with
tabs; :func:`numpy.savetxt` writes blanks.
"""

import codecs
import csv
import io
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError, opening, unknown
from stiction_envs.reporting.atomic import write_text_atomic

FIRST_BYTES = 65_536  # bytes of a file in which its header must end; assumed
Cells = Sequence[Any]
"""Cells of a row: texts, and numbers as `float` takes them."""
UTF8 = "utf-8-sig"
"""UTF-8 with or without a mark."""
POINTER = b"version https://git-lfs.github.com/spec/"
"""How a pointer of Git LFS begins. Source: the specification of git-lfs."""
_NUMBER = re.compile(r'[\s"]*[-+]?([.,]?\d|(nan|inf)\b)', re.IGNORECASE)
_BETWEEN = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}


@dataclass(frozen=True)
class Dialect:
    """Characters between the cells of a table, and before the decimals of its numbers."""

    delimiter: str
    """A blank stands for any white space."""
    decimal_comma: bool

    def cells(self, line: bytes) -> list[bytes]:
        """Return the cells of a row of numbers, with decimal points."""
        line = line.replace(b'"', b"")
        cells = line.split(None if self.delimiter == " " else self.delimiter.encode())
        return [x.replace(b",", b".") for x in cells] if self.decimal_comma else cells

    def names(self, line: str) -> list[str]:
        """Return the cells of a header."""
        if self.delimiter == " ":
            return line.split()
        with suppress(csv.Error):
            return [x.strip() for x in next(csv.reader([line], delimiter=self.delimiter), [])]
        return [x.strip() for x in line.split(self.delimiter)]

    @property
    def notes(self) -> list[str]:
        """Remark for a person; none for commas between cells and decimal points."""
        commas = " and decimal commas" * self.decimal_comma
        between = _BETWEEN.get(self.delimiter)
        return [f"a table with {between} between its cells{commas}"] if between else []


def dialect_of(header: str, row: str) -> Dialect:
    """Return the dialect of a table by its header and its first row of numbers."""
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "", header)
    delimiter = max(",;\t|", key=bare.count)
    if delimiter not in bare:
        delimiter = " " if len(bare.split()) > 1 and len(row.split()) > 1 else ","
    return Dialect(delimiter, delimiter != "," and "," in row)


def is_number(text: str) -> bool:
    """Return whether a text begins with a number: a row does, a header does not."""
    return _NUMBER.match(text) is not None


def header_in(lines: Iterable[str]) -> tuple[str, bool]:
    """Return the header among the first lines of a table, and whether a row followed at once.

    Lines that begin with ``#`` and Excel's ``sep=;`` do not count; where numbers follow them, the
    last one is the header, as :func:`numpy.savetxt` writes it. Empty where there is none.
    """
    comment = ""
    for line in lines:
        if line.startswith("#"):
            comment = line[1:]
        elif is_number(line):
            return comment, True
        elif line.strip() and not line.lower().startswith("sep="):
            return line, False
    return comment, False


def encoding_of(start: bytes) -> str:
    """Return the encoding of a text by its first bytes: a mark, or zeros between letters."""
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if len(start) > 3 and [bool(x) for x in start[:4]] in ([True, False] * 2, [False, True] * 2):
        return "utf-16-le" if start[0] else "utf-16-be"
    return UTF8


def refuse_pointer(path: str | os.PathLike[str]) -> None:
    """Raise if a file is a pointer of Git LFS, which stands for a file that was not fetched."""
    with suppress(OSError), open(path, "rb") as file:
        if file.read(len(POINTER)) == POINTER:
            raise StictionError(
                f"{os.fspath(path)}: a pointer of Git LFS and not the file itself: expected the "
                "file; run `git lfs pull` in its repository"
            )


class Line:
    """One line of a table: its fields by column name, and where it is."""

    def __init__(self, where: str, fields: dict[str, str]) -> None:
        self.where = where
        """``path, line number``, the beginning of every message about this line."""
        self.fields = fields

    def error(self, message: str) -> StictionError:
        """Return an error at this line."""
        return StictionError(f"{self.where}: {message}")

    @contextmanager
    def named(self) -> Iterator[None]:
        """Put this line before the message of an error."""
        try:
            yield
        except StictionError as error:
            raise self.error(str(error)) from None

    def name(self, column: str, expected: Sequence[str]) -> str:
        """Return the field as one of the ``expected`` names."""
        value = self.fields[column]
        if value not in expected:
            raise self.error(str(unknown(column, value, expected)))
        return value

    def text(self, column: str) -> str:
        """Return the field as text that is not empty."""
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
        """Return the field as a finite number from ``low``, NaN if ``nan``, or ``default``."""
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
        """Return the field as a whole number in ``low`` … ``high``."""
        value = self.number(column)
        if value % 1 or value < low or (high is not None and value > high):
            to = "" if high is None else f" to {high}"
            raise self.error(
                f"{column} is {self.fields[column]}: expected a whole number from {low}{to}"
            )
        return int(value)


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file in UTF-8 or UTF-16, with line ends as they are."""
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
    """Return the lines of a table whose header names every required column, in any order."""
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
    """Return the columns of a CSV; none if it is empty or cannot be read."""
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


def write_rows(path: str | os.PathLike[str], rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows of cells by column, as `write_lines`; a cell that a row lacks is empty."""
    header = list(dict.fromkeys(name for row in rows for name in row))
    write_lines(path, header, [[row.get(name, "") for name in header] for row in rows])


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
