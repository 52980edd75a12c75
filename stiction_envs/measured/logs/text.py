"""Rows of comma-separated numbers, block by block, with errors that name line and column."""

from __future__ import annotations

import csv
import io

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.columns import Columns

Array = NDArray[np.float64]
MISSING = ("", "nan", "na", "n/a", "null", "none")
"""How a cell says that it has no value, in any case of letters."""


def decode_header(
    where: str, block: bytes, line: int, most_bytes: int
) -> tuple[list[str] | None, bytes, int]:
    """Names in the first line that is not blank, the rest of the block, and its first line number.

    A leading ``#`` (as :func:`numpy.savetxt` writes it) does not count. None for a blank block.

    Raises:
        StictionError: the line is over ``most_bytes`` long or not UTF-8.
    """
    while block:
        raw, _, block = block.partition(b"\n")
        here, line = line, line + 1
        if len(raw) > most_bytes:
            raise StictionError(
                f"{where}, line {here}: over {most_bytes} bytes: expected comma-separated text"
            )
        try:
            text = raw.decode("utf-8-sig").strip()
        except UnicodeDecodeError as error:
            raise StictionError(
                f"{where}, line {here}: byte {error.start} is not UTF-8: expected CSV in UTF-8"
            ) from None
        if "\0" in text:
            raise StictionError(
                f"{where}, line {here}: not text: expected comma-separated text in UTF-8"
            )
        if text:
            try:
                names = next(csv.reader([text.removeprefix("#")]), [])
            except csv.Error:
                names = text.split(",")
            return [name.strip() for name in names], block, line
    return None, b"", line


class TextRows:
    """Collects the numbers of a CSV file as its blocks come in."""

    def __init__(self, where: str, header: list[str], columns: Columns) -> None:
        self.where = where
        self.header = header
        self.columns = columns
        self.count = 0
        """Rows so far."""
        self._numbers = [c for c in columns.numbers if c >= 0]
        self._values: list[Array] = []
        self._lines: list[NDArray[np.int32]] = []
        self._runs: list[NDArray[np.int64]] = []
        self._label: bytes | None = None
        self._run = 0

    def add(self, block: bytes, line: int) -> int:
        """Read the whole lines of ``block``, the first of which has number ``line``.

        Returns:
            The number of the line after the block.

        Raises:
            StictionError: a row with too few or too many values, or a value that is no number.
        """
        block = block.replace(b"\r\n", b"\n").replace(b'"', b"")
        lines, width = block.split(b"\n")[:-1], len(self.header)
        rows = []
        for i, text in enumerate(lines):
            commas = text.count(b",")
            if text and commas == width - 1:
                rows.append(i)
            elif text.strip():
                raise StictionError(
                    f"{self.where}, line {line + i}: {commas + 1} values: "
                    f"expected one for each of the {width} columns"
                )
        if rows:
            values = self._fast(block, len(rows))
            self._values.append(self._slow(lines, rows, line) if values is None else values)
            self._lines.append((line + np.array(rows)).astype(np.int32))
            self._runs.append(self._label_rows(lines, rows))
            self.count += len(rows)
        return line + len(lines)

    def take(self) -> tuple[Array, NDArray[np.int64], NDArray[np.int32]]:
        """Values (T, k) of the columns with numbers, number of the run (T,), line number (T,)."""
        if not self._values:
            none = np.zeros(0, np.int64)
            return np.zeros((0, len(self._numbers))), none, none.astype(np.int32)
        parts = self._values, self._runs, self._lines
        self._values, self._runs, self._lines = [], [], []
        return np.concatenate(parts[0]), np.concatenate(parts[1]), np.concatenate(parts[2])

    def _fast(self, block: bytes, count: int) -> Array | None:
        if b",," in block or b",\n" in block or b"\n," in block or block[:1] == b",":
            block = block.replace(b",,", b",nan,").replace(b",,", b",nan,")
            block = block.replace(b",\n", b",nan\n").replace(b"\n,", b"\nnan,")
            block = b"nan" + block if block[:1] == b"," else block
        try:
            values = np.loadtxt(
                io.StringIO(block.decode("ascii")),
                delimiter=",",
                usecols=self._numbers,
                comments=None,
                ndmin=2,
            )
        except ValueError:
            return None
        return values if len(values) == count else None

    def _slow(self, lines: list[bytes], rows: list[int], line: int) -> Array:
        """Cell by cell: what :meth:`_fast` could not read, or an error that says where."""
        values = np.empty((len(rows), len(self._numbers)))
        for k, i in enumerate(rows):
            cells = lines[i].split(b",")
            for m, column in enumerate(self._numbers):
                raw = cells[column].strip()
                try:
                    # Python's own 1_000 is no number anywhere else.
                    values[k, m] = float("?" if b"_" in raw else raw.decode("ascii"))
                except ValueError:
                    shown = raw.decode("utf-8", "replace")
                    if shown.lower() in MISSING:
                        values[k, m] = np.nan
                        continue
                    short = shown if len(shown) < 40 else shown[:37] + "..."
                    raise StictionError(
                        f"{self.where}, line {line + i}: {self.header[column]} is {short!r}: "
                        "expected numbers"
                    ) from None
        return values

    def _label_rows(self, lines: list[bytes], rows: list[int]) -> NDArray[np.int64]:
        column = self.columns.run
        if column is None:
            return np.zeros(len(rows), np.int64)
        labels = [lines[i].split(b",", column + 1)[column].strip() for i in rows]
        before = [labels[0] if self._label is None else self._label, *labels[:-1]]
        self._label = labels[-1]
        new = np.fromiter((a != b for a, b in zip(labels, before, strict=True)), bool, len(labels))
        run = self._run + np.cumsum(new)
        self._run = int(run[-1])
        return run
