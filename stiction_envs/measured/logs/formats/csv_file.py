"""CSV text, gzip-compressed or not: our columns, or those of a robot's own log."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator, Sequence
from io import BufferedReader
from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import header_of
from stiction_envs.measured.logs.columns import drives_in, joints_of, sort_columns
from stiction_envs.measured.logs.formats.base import (
    MOST_BYTES,
    MOST_LINE_BYTES,
    LogFormat,
    RawLog,
    Wanted,
    check_size,
)
from stiction_envs.measured.logs.formats.franka import FRANKA_ROS, LIBFRANKA
from stiction_envs.measured.logs.formats.header import OUR_COLUMNS, About, Header
from stiction_envs.measured.logs.formats.plotjuggler import PLOTJUGGLER, measured_rows
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.text import TextRows, decode_header

HEADERS = [LIBFRANKA, FRANKA_ROS, PLOTJUGGLER]
"""Columns of robots' own logs; any other CSV has ours. `registry.register` adds more."""

_BLOCK = 2**22
"""Bytes read at once; assumed."""
_BROKEN = (EOFError, zlib.error, gzip.BadGzipFile)


class CsvFile(LogFormat):
    """Comma-separated numbers below a header."""

    ends: ClassVar = (".csv", ".csv.gz")
    has_names: ClassVar = True
    has_topics: ClassVar = True

    def read(self, where: str, wanted: Wanted) -> RawLog:
        """See `LogFormat.read`."""
        return _read_csv(where, wanted)

    def count(self, where: str, naming: Naming) -> int:
        """See `LogFormat.count`."""
        return joints_of(_our_names(where, naming))

    def drives(self, where: str, naming: Naming) -> tuple[str, ...]:
        """See `LogFormat.drives`."""
        return drives_in(_our_names(where, naming))


def known_header(names: Sequence[str]) -> Header:
    """Return the kind of log that has these columns."""
    return next((h for h in HEADERS if h.mark in names), OUR_COLUMNS)


def _our_names(where: str, naming: Naming) -> list[str]:
    """Return our names of a file's columns."""
    names = header_of(where)
    if not names:
        raise StictionError(f"{where}: empty file: expected t,q1..qn,tau1..taun")
    return known_header(names).ours(names, About(where=where, naming=naming))


def _read_csv(where: str, wanted: Wanted) -> RawLog:
    time, kind, packed = wanted.time, OUR_COLUMNS, where.lower().endswith(".gz")
    rows: TextRows | None = None
    line = 1
    try:
        with open(where, "rb") as file:
            start = file.read(2)
            file.seek(0)
            if packed and start and start != b"\x1f\x8b":
                raise StictionError(
                    f"{where}: not gzip: expected gzip-compressed CSV, or the name .csv"
                )
            if not packed and start == b"\x1f\x8b":
                raise StictionError(f"{where}: gzip-compressed: expected the name .csv.gz")
            stream = gzip.GzipFile(fileobj=file) if packed else file
            for block in _blocks(where, stream):
                if rows is None:
                    header, block, line = decode_header(where, block, line, MOST_LINE_BYTES)
                    if header is None:
                        continue
                    kind = known_header(header)
                    if not kind.has_names:
                        _check_unnamed(where, wanted.naming)
                    about = About(where=where, naming=wanted.naming, n_joints=wanted.n_joints)
                    names = kind.ours(header, about)
                    columns = sort_columns(
                        where, names, wanted.n_joints, time=time, drive=wanted.drive
                    )
                    rows = TextRows(where, header, columns)
                line = rows.add(block, line)
                check_size(where, rows.count, len(rows.columns.numbers))
    except _BROKEN as error:
        reason = "ends early" if isinstance(error, EOFError) else "is damaged"
        raise StictionError(
            f"{where}: the compressed file {reason} after line {line - 1}: "
            "expected a whole gzip file"
        ) from None
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{where}: {reason}: expected a readable log file") from None
    if rows is None:
        raise StictionError(f"{where}: empty file: expected a header and one second of rows")
    values, run, lines = rows.take()
    columns = rows.columns
    start_column, data = int(time), {}
    for channel, group in columns.channels.items():
        data[channel] = np.ascontiguousarray(values[:, start_column : start_column + len(group)])
        start_column += len(group)
    t = values[:, 0] / kind.per_second if time else np.arange(float(len(values)))
    if kind.sparse:
        keep = measured_rows(data)
        t, run, lines = t[keep], run[keep], lines[keep]
        data = {k: np.ascontiguousarray(x[keep]) for k, x in data.items()}
    log = RawLog(
        source=where,
        t=t,
        data=data,
        run=run,
        place=lambda i: f"{where}, line {lines[i]}",
        ignored=columns.ignored if kind is OUR_COLUMNS else (),
        side=kind.side,
    )
    if kind.note:
        log.note(kind.note)
    log.note_renamed(columns)
    return log


def _check_unnamed(where: str, naming: Naming) -> None:
    """Refuse names for a log whose joints have numbers."""
    for option, given in (("joints", naming.joints), ("topic", naming.topic)):
        if given:
            raise StictionError(
                f"{option}: the joints of {where} have numbers: expected a log with names"
            )


def _blocks(where: str, stream: gzip.GzipFile | BufferedReader) -> Iterator[bytes]:
    """Whole lines in blocks of some megabytes; the last line gets an end if it has none.

    Lines before a damage of the file come first, so that the error can name the place.
    """
    rest, total, broken = bytearray(), 0, None
    while True:
        try:
            chunk = stream.read1(_BLOCK)
        except _BROKEN as error:
            broken = error
            break
        if not chunk:
            break
        total += len(chunk)
        if total > MOST_BYTES:
            raise StictionError(
                f"{where}: over {MOST_BYTES >> 20} MiB of text: expected a shorter log"
            )
        line_start = rest.rfind(b"\n") + 1
        rest += chunk
        if len(rest) - line_start > MOST_LINE_BYTES and rest.find(b"\n", line_start) < 0:
            raise StictionError(
                f"{where}: a line of over {MOST_LINE_BYTES} bytes: expected comma-separated text"
            )
        if len(rest) > _BLOCK:
            end = rest.rfind(b"\n") + 1
            yield bytes(rest[:end])
            del rest[:end]
    if broken is None and rest and not rest.endswith(b"\n"):
        rest += b"\n"
    end = rest.rfind(b"\n") + 1
    if end:
        yield bytes(rest[:end])
    if broken is not None:
        raise broken
