"""CSV text, gzip-compressed or not: our columns, or those of a robot's own log."""

import gzip
import io
import math
import zlib
from array import array
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from operator import itemgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.measured import csv_text
from stiction_envs.measured.logs.aliases import OurNames, listed_names, our_names, unit_of
from stiction_envs.measured.logs.columns import Columns, sort_columns
from stiction_envs.measured.logs.formats.base import (
    MOST_BYTES,
    MOST_LINE_BYTES,
    OUR_COLUMNS,
    Header,
    LogFormat,
    RawLog,
    Wanted,
    check_size,
    log_of_columns,
)
from stiction_envs.measured.logs.formats.franka import FRANKA_ROS, LIBFRANKA
from stiction_envs.measured.logs.formats.plotjuggler import PLOTJUGGLER, measured_rows
from stiction_envs.measured.logs.joint_names import Naming, check_unnamed

HEADERS = [LIBFRANKA, FRANKA_ROS, PLOTJUGGLER]
"""Columns of robots' own logs; any other CSV has ours. `registry.register` adds more."""

MISSING = ("", "nan", "na", "n/a", "null", "none")
"""How a cell says that it has no value, in any case of letters."""
_GZIP = b"\x1f\x8b"


class CsvFile(LogFormat):
    """Numbers between commas, semicolons, tabs or blanks below a header."""

    ends: ClassVar = tuple(end + gz for end in (".csv", ".tsv", ".txt") for gz in ("", ".gz"))

    def read(self, where: str, wanted: Wanted) -> RawLog:
        text = _open(where, wanted.naming)
        kind, ours = _our_names(where, text, wanted.naming, wanted.n_joints)
        columns = sort_columns(where, ours.names, wanted, text.names)
        table, numbers = _table(where, text, columns)
        log = log_of_columns(where, columns, ours, table.__getitem__, wanted, "line", numbers)
        for remark in text.notes:
            log.note(remark)
        if wanted.time:
            log.t /= kind.per_second
        if kind.sparse:
            keep = measured_rows(log.data)
            numbers, log.t, log.run = numbers[keep], log.t[keep], log.run[keep]
            log.data = {k: np.ascontiguousarray(x[keep]) for k, x in log.data.items()}
            log.place = lambda i: f"{where}, line {numbers[i]}"
        if kind is not OUR_COLUMNS:
            log.side, log.ignored = kind.side, ()
            log.note(kind.note)
        return log

    def names(self, where: str, naming: Naming) -> list[str]:
        return _our_names(where, _open(where, naming), naming)[1].names


def known_header(names: Sequence[str]) -> Header:
    """Return the kind of log that has these columns."""
    return next((h for h in HEADERS if h.mark in names), OUR_COLUMNS)


@dataclass
class _Table:
    """An opened CSV."""

    names: list[str]
    units: list[str]
    """Units of a row below the names; none where there is no such row."""
    dialect: csv_text.Dialect
    rows: Iterator[tuple[int, bytes]]
    """Number and bytes in UTF-8 of each line below."""
    notes: list[str]


def _our_names(
    where: str, table: _Table, naming: Naming, n_joints: int | None = None
) -> tuple[Header, OurNames]:
    """Return the kind of a table, and our names of its columns."""
    kind = known_header(table.names)
    if kind is OUR_COLUMNS:
        if naming.topic is not None:
            check_unnamed(where, naming)
        return kind, our_names(where, table.names, naming, n_joints, table.units)
    if not kind.has_names:
        check_unnamed(where, naming)
    return kind, OurNames(names=kind.ours(table.names, where, naming, n_joints))


def _open(where: str, naming: Naming) -> _Table:
    """Open a CSV and read its names, units and dialect."""
    lines, rows = _lines(where), deque[tuple[int, bytes]](maxlen=1)

    def texts() -> Iterator[str]:
        for number, line in lines:
            rows.append((number, line))
            yield _text(where, number, line)

    header, below = csv_text.header_in(texts())
    if not below:
        rows = deque(islice(lines, 1))
    sample = rows[0][1].decode("utf-8", "replace") if rows else ""
    dialect = csv_text.dialect_of(header or sample, sample)
    names = dialect.names(header or sample)
    if not names:
        raise StictionError(f"{where}: empty file: expected a header and one second of rows")
    if not header and not listed_names(naming.columns):
        raise StictionError(
            f"{where}, line {rows[0][0]}: numbers without a header: expected a header, or columns "
            "with a name for each, as in columns t q1..q6 tau1..tau6"
        )
    units = [] if csv_text.is_number(sample) else dialect.names(sample.strip())
    if len(units) != len(names) or not any(units) or None in map(unit_of, units):
        units = []
    return _Table(names, units, dialect, chain([] if units else rows, lines), dialect.notes)


def _lines(where: str) -> Iterator[tuple[int, bytes]]:
    """Yield the number and the bytes in UTF-8 of each line that is not blank."""
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
            encoding, most = csv_text.encoding_of(stream.read(4)), MOST_LINE_BYTES + 1
            stream.seek(0)
            wide = io.TextIOWrapper(stream, encoding) if encoding != csv_text.UTF8 else None
            while line := wide.readline(most).encode() if wide else stream.readline(most):
                number, total = number + 1, total + len(line)
                if len(line) > MOST_LINE_BYTES:
                    raise StictionError(
                        f"{where}, line {number}: a line of over {MOST_LINE_BYTES} bytes: "
                        "expected a table as text"
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
    except UnicodeError:
        raise StictionError(
            f"{where}: no UTF-16 after line {number}: expected text in UTF-8 or UTF-16"
        ) from None
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{where}: {reason}: expected a readable log file") from None


def _text(where: str, number: int, line: bytes) -> str:
    """Return a line above the numbers; Windows' letters where it is not UTF-8."""
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = line.decode("cp1252", "replace")
    if any(ord(c) < 32 and not c.isspace() for c in text):
        raise StictionError(
            f"{where}, line {number}: not text: expected a table as text in UTF-8 or UTF-16"
        )
    return text.strip("\r\n")


def _table(
    where: str, text: _Table, columns: Columns
) -> tuple[dict[int, Array], NDArray[np.int32]]:
    """Return the used columns by their place, and the line of each row; runs have numbers."""
    used = columns.numbers
    pick, width, split = itemgetter(*used), len(text.names), text.dialect.cells
    values, labels, numbers = array("d"), array("d"), array("i")
    codes: dict[bytes, int] = {}
    for number, line in text.rows:
        cells = split(line)
        try:
            mine = pick(cells)
            # float takes Python's own 1_000, which is no number anywhere else
            unfit = len(cells) != width or b"_" in b"".join(mine)
            row = [] if unfit else [*map(float, mine)]
        except (ValueError, IndexError):
            row = []
        if not row:
            try:
                row = _numbers(f"{where}, line {number}", text.names, cells, used)
            except StictionError:
                if line.endswith(b"\n"):
                    raise
                text.notes.append(f"line {number}, the last one, is cut off: left out")
                break
        values.extend(row)
        numbers.append(number)
        if columns.run is not None:
            labels.append(codes.setdefault(cells[columns.run].strip(), len(codes)))
        check_size(where, len(numbers), len(used))
    table = dict(zip(used, np.array(values).reshape(-1, len(used)).T, strict=True))
    if columns.run is not None:
        table[columns.run] = np.array(labels)
    return table, np.array(numbers, np.int32)


def _numbers(
    place: str, names: Sequence[str], cells: Sequence[bytes], used: Sequence[int]
) -> list[float]:
    """Return the used numbers of a row, NaN for cells without a value."""
    if len(cells) != len(names):
        commas = "; decimal commas need semicolons between the cells"
        raise StictionError(
            f"{place}: {len(cells)} values: expected one for each of the {len(names)} columns"
            f"{commas * (len(cells) >= 2 * len(names) - 1 > 1)}"
        )
    return [_number(place, names[c], cells[c]) for c in used]


def _number(place: str, column: str, cell: bytes) -> float:
    raw = cell.strip()
    try:
        return float("?" if b"_" in raw else raw.decode("ascii"))
    except ValueError:
        shown = raw.decode("utf-8", "replace")
    if shown.lower() in MISSING:
        return math.nan
    short = shown if len(shown) < 40 else shown[:37] + "..."
    raise StictionError(f"{place}: {column} is {short!r}: expected numbers")
