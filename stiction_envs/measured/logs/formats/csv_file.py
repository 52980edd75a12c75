"""CSV text, gzip-compressed or not: our columns, or those of a robot's own log."""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from array import array
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.columns import Columns, sort_columns
from stiction_envs.measured.logs.formats.base import (
    MOST_BYTES,
    MOST_LINE_BYTES,
    NamedColumns,
    RawLog,
    Wanted,
    check_size,
    check_unnamed,
    log_of_columns,
)
from stiction_envs.measured.logs.formats.franka import FRANKA_ROS, LIBFRANKA
from stiction_envs.measured.logs.formats.header import OUR_COLUMNS, Header
from stiction_envs.measured.logs.formats.plotjuggler import PLOTJUGGLER, measured_rows
from stiction_envs.measured.logs.joint_names import Naming

HEADERS = [LIBFRANKA, FRANKA_ROS, PLOTJUGGLER]
"""Columns of robots' own logs; any other CSV has ours. `registry.register` adds more."""

MISSING = ("", "nan", "na", "n/a", "null", "none")
"""How a cell says that it has no value, in any case of letters."""
Array = NDArray[np.float64]
_GZIP = b"\x1f\x8b"
"""The first bytes of a gzip file."""


class CsvFile(NamedColumns):
    """Comma-separated numbers below a header."""

    ends: ClassVar = (".csv", ".csv.gz")

    def read(self, where: str, wanted: Wanted) -> RawLog:
        """See `LogFormat.read`."""
        return _read_csv(where, wanted)

    def names(self, where: str, naming: Naming) -> list[str]:
        """See `NamedColumns.names`."""
        names = _header(where, _lines(where))
        return known_header(names).ours(names, where, naming)


def known_header(names: Sequence[str]) -> Header:
    """Return the kind of log that has these columns."""
    return next((h for h in HEADERS if h.mark in names), OUR_COLUMNS)


def _read_csv(where: str, wanted: Wanted) -> RawLog:
    lines = _lines(where)
    header = _header(where, lines)
    kind = known_header(header)
    if not kind.has_names:
        check_unnamed(where, wanted.naming)
    names = kind.ours(header, where, wanted.naming, wanted.n_joints)
    columns = sort_columns(where, names, wanted.n_joints, time=wanted.time, drive=wanted.drive)
    table, numbers = _table(where, lines, header, columns)
    log = log_of_columns(
        where, columns, table.__getitem__, len(numbers), wanted, lambda i: f"line {numbers[i]}"
    )
    if wanted.time:
        log.t /= kind.per_second
    if kind.sparse:
        keep = measured_rows(log.data)
        numbers, log.t, log.run = numbers[keep], log.t[keep], log.run[keep]
        log.data = {k: np.ascontiguousarray(x[keep]) for k, x in log.data.items()}
    if kind is not OUR_COLUMNS:
        log.side, log.ignored = kind.side, ()
        log.note(kind.note)
    return log


def _lines(where: str) -> Iterator[tuple[int, bytes]]:
    """Yield the number and the bytes of each line that is not blank.

    Raises:
        StictionError: the file cannot be read, is too large, damaged, or packed and not named so.
    """
    packed, number, total = where.lower().endswith(".gz"), 0, 0
    try:
        with open(where, "rb") as file:
            start = file.read(2)
            file.seek(0)
            if packed and start and start != _GZIP:
                raise StictionError(
                    f"{where}: not gzip: expected gzip-compressed CSV, or the name .csv"
                )
            if not packed and start == _GZIP:
                raise StictionError(f"{where}: gzip-compressed: expected the name .csv.gz")
            stream = gzip.GzipFile(fileobj=file) if packed else file
            while line := stream.readline(MOST_LINE_BYTES + 1):
                number, total = number + 1, total + len(line)
                if len(line) > MOST_LINE_BYTES:
                    raise StictionError(
                        f"{where}, line {number}: a line of over {MOST_LINE_BYTES} bytes: "
                        "expected comma-separated text"
                    )
                if total > MOST_BYTES:
                    raise StictionError(
                        f"{where}: over {MOST_BYTES >> 20} MiB of text: expected a shorter log"
                    )
                if line.strip():
                    yield number, line
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        reason = "ends early" if isinstance(error, EOFError) else "is damaged"
        raise StictionError(
            f"{where}: the compressed file {reason} after line {number}: expected a whole gzip file"
        ) from None
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{where}: {reason}: expected a readable log file") from None


def _header(where: str, lines: Iterable[tuple[int, bytes]]) -> list[str]:
    """Return the names in the first line.

    A leading ``#`` (as :func:`numpy.savetxt` writes it) does not count.
    """
    for number, line in lines:
        here = f"{where}, line {number}"
        try:
            text = line.decode("utf-8-sig").strip()
        except UnicodeDecodeError as error:
            raise StictionError(
                f"{here}: byte {error.start} is not UTF-8: expected CSV in UTF-8"
            ) from None
        if "\0" in text:
            raise StictionError(f"{here}: not text: expected comma-separated text in UTF-8")
        try:
            names = next(csv.reader([text.removeprefix("#")]), [])
        except csv.Error:
            names = text.split(",")
        if names:
            return [name.strip() for name in names]
    raise StictionError(f"{where}: empty file: expected a header and one second of rows")


def _table(
    where: str, lines: Iterable[tuple[int, bytes]], header: Sequence[str], columns: Columns
) -> tuple[dict[int, Array], NDArray[np.int32]]:
    """Return the used columns by their place, and the line of each row.

    Of the runs' labels there are numbers, one for each label.

    Raises:
        StictionError: a row with too few or too many values, or a value that is no number.
    """
    used = columns.numbers
    pick, width = itemgetter(*used), len(header)
    values, labels, numbers = array("d"), array("d"), array("i")
    codes: dict[bytes, int] = {}
    for number, line in lines:
        cells = line.replace(b'"', b"").split(b",")
        if len(cells) != width:
            raise StictionError(
                f"{where}, line {number}: {len(cells)} values: "
                f"expected one for each of the {width} columns"
            )
        try:
            mine = pick(cells)
            # float takes Python's own 1_000, which is no number anywhere else
            row = [] if b"_" in b"".join(mine) else [*map(float, mine)]
        except ValueError:
            row = []
        values.extend(row or [_number(where, number, header[c], cells[c]) for c in used])
        numbers.append(number)
        if columns.run is not None:
            labels.append(codes.setdefault(cells[columns.run].strip(), len(codes)))
        check_size(where, len(numbers), len(used))
    table = dict(zip(used, np.array(values).reshape(-1, len(used)).T, strict=True))
    if columns.run is not None:
        table[columns.run] = np.array(labels)
    return table, np.array(numbers, np.int32)


def _number(where: str, line: int, column: str, cell: bytes) -> float:
    raw = cell.strip()
    try:
        return float("?" if b"_" in raw else raw.decode("ascii"))
    except ValueError:
        shown = raw.decode("utf-8", "replace")
    if shown.lower() in MISSING:
        return math.nan
    short = shown if len(shown) < 40 else shown[:37] + "..."
    raise StictionError(f"{where}, line {line}: {column} is {short!r}: expected numbers")
