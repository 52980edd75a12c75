"""How people's text tables are written: encoding, delimiter, decimal commas.

Every CSV that is read asks here. Excel writes semicolons and decimal commas in most of Europe, and
"Unicode text" as UTF-16 with tabs; :func:`numpy.savetxt` writes blanks.
"""

from __future__ import annotations

import codecs
import csv
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

from stiction_envs.errors import StictionError

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
