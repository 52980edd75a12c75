"""Joint logs as files: CSV, gzip-compressed CSV, NumPy archives and Parquet into arrays.

What is read here is what is in the file; :mod:`stiction_envs.measured.logs.reader` says
whether it can be a measurement. Files come from strangers: every size is bounded before memory is
taken, and nothing is unpickled.
"""

from __future__ import annotations

import gzip
import os
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.measured.logs.columns import Columns, sort_columns
from stiction_envs.measured.logs.text import TextRows, decode_header
from stiction_envs.measured.settings import FileSettings, measured_settings

KINDS = (".csv", ".csv.gz", ".npz", ".parquet")
"""Ends of the file names that are read."""

_BLOCK = 2**22
_BROKEN = (EOFError, zlib.error, gzip.BadGzipFile)


@dataclass(kw_only=True)
class RawLog:
    """A log as it is in the file."""

    source: str
    """Path as given."""
    t: NDArray[np.float64]
    """Logged time, (T,), s; row numbers where the log has none."""
    data: dict[str, NDArray[np.float64]]
    """``q``, ``tau`` and the optional channels, (T, n) each."""
    run: NDArray[np.int64]
    """Number of the recording of each row, (T,), from 0."""
    place: Callable[[int], str]
    """Where a row is, such as ``a.csv, line 17``."""
    ignored: tuple[str, ...]
    """Columns that are not used."""


def read_raw(
    path: str | os.PathLike[str],
    n_joints: int,
    *,
    time: bool = True,
    settings: FileSettings | None = None,
) -> RawLog:
    """Read the numbers of a log file, whatever its kind.

    Args:
        path: a file whose name ends in one of :data:`KINDS`.
        n_joints: joints of the robot.
        time: whether there must be a column ``t``.
        settings: sizes that are read; None for those of ``settings.toml``.

    Raises:
        StictionError: the file cannot be read, is too large, or is not a log of such a robot.
    """
    s = settings or measured_settings().files
    name = Path(path).name.lower()
    kind = next((k for k in reversed(KINDS) if name.endswith(k)), None)
    where = os.fspath(path)
    _check_regular(where)
    if kind is None:
        raise StictionError(f"{where}: unknown kind of file: expected one of {', '.join(KINDS)}")
    if kind == ".npz":
        raw = _from_columns(where, _read_npz(where, s), n_joints, time, s)
    elif kind == ".parquet":
        raw = _from_columns(where, _read_parquet(where, s), n_joints, time, s)
    else:
        raw = _read_csv(where, n_joints, time, s, packed=kind == ".csv.gz")
    if not len(raw.t):
        raise StictionError(f"{where}: no rows below the header: expected one second or more")
    return raw


def _check_regular(where: str) -> None:
    # Asked before opening: a pipe or a device would never end.
    try:
        mode = os.stat(where).st_mode
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise StictionError(f"{where}: {reason.lower()}: expected a log file") from None
    if not stat.S_ISREG(mode):
        what = "a directory" if stat.S_ISDIR(mode) else "no regular file"
        raise StictionError(f"{where}: {what}: expected a log file ({', '.join(KINDS)})")


def _read_csv(where: str, n_joints: int, time: bool, s: FileSettings, *, packed: bool) -> RawLog:
    rows: TextRows | None = None
    columns: Columns | None = None
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
            stream: Any = gzip.GzipFile(fileobj=file) if packed else file
            for block in _blocks(where, stream, s):
                if rows is None:
                    header, block, line = decode_header(where, block, line, s.most_line_bytes)
                    if header is None:
                        continue
                    columns = sort_columns(where, header, n_joints, time=time)
                    rows = TextRows(where, header, columns)
                line = rows.add(block, line)
                if rows.count * len(columns.numbers if columns else ()) > s.most_values:
                    raise _too_many(where, rows.count, s)
    except _BROKEN as error:
        reason = "ends early" if isinstance(error, EOFError) else "is damaged"
        raise StictionError(
            f"{where}: the compressed file {reason} after line {line - 1}: "
            "expected a whole gzip file"
        ) from None
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise StictionError(f"{where}: {reason}: expected a readable log file") from None
    if rows is None or columns is None:
        raise StictionError(f"{where}: empty file: expected a header and one second of rows")
    values, run, lines = rows.take()
    start_column, data = int(time), {}
    for channel, group in columns.channels.items():
        data[channel] = np.ascontiguousarray(values[:, start_column : start_column + len(group)])
        start_column += len(group)
    return RawLog(
        source=where,
        t=values[:, 0].copy() if time else np.arange(float(len(values))),
        data=data,
        run=run,
        place=lambda i: f"{where}, line {lines[i]}",
        ignored=columns.ignored,
    )


def _blocks(where: str, stream: Any, s: FileSettings) -> Iterator[bytes]:
    """Whole lines in blocks of some megabytes; the last line gets an end if it has none.

    What is before a damage of the file comes first, so that the error can say where it is.
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
        if total > s.most_bytes:
            raise StictionError(
                f"{where}: over {s.most_bytes >> 20} MiB of text: expected a shorter log"
            )
        line_start = rest.rfind(b"\n") + 1
        rest += chunk
        if len(rest) - line_start > s.most_line_bytes and rest.find(b"\n", line_start) < 0:
            raise StictionError(
                f"{where}: a line of over {s.most_line_bytes} bytes: expected comma-separated text"
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


def _too_many(where: str, rows: int, s: FileSettings) -> StictionError:
    return StictionError(
        f"{where}: {rows} rows or more: expected at most {s.most_values} numbers in one log; "
        "split it or thin it out"
    )


def _from_columns(
    where: str, arrays: dict[str, NDArray[Any]], n_joints: int, time: bool, s: FileSettings
) -> RawLog:
    """A log from named columns, all (T,), or matrices (T, n) by the name of their channel."""
    flat: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        if array.ndim == 2 and array.shape[1] < 100:
            flat.update({f"{name}{j + 1}": array[:, j] for j in range(array.shape[1])})
        elif array.ndim == 1:
            flat[name] = array
    names = list(flat)
    columns = sort_columns(where, names, n_joints, time=time)
    used = [c for c in (*columns.numbers, columns.run) if c is not None and c >= 0]
    length = len(flat[names[used[0]]])
    for c in used:
        array = flat[names[c]]
        if len(array) != length:
            raise StictionError(
                f"{where}: column {names[c]!r} has {len(array)} rows, "
                f"{names[used[0]]!r} has {length}: expected one length for all"
            )
        if c != columns.run and array.dtype.kind not in "fiu":
            raise StictionError(
                f"{where}: column {names[c]!r} holds {array.dtype}: expected numbers"
            )
    if length * len(used) > s.most_values:
        raise _too_many(where, length, s)
    run = np.zeros(length, np.int64)
    if columns.run is not None and length:
        label = flat[names[columns.run]]
        run[1:] = np.cumsum(label[1:] != label[:-1])
    return RawLog(
        source=where,
        t=np.array(flat["t"], np.float64) if time else np.arange(float(length)),
        data={
            channel: np.stack([np.asarray(flat[names[c]], np.float64) for c in group], axis=1)
            for channel, group in columns.channels.items()
        },
        run=run,
        place=lambda i: f"{where}, row {i + 1}",
        ignored=columns.ignored,
    )


def _read_npz(where: str, s: FileSettings) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    member = ""
    try:
        with zipfile.ZipFile(where) as archive:
            if sum(info.file_size for info in archive.infolist()) > s.most_bytes:
                raise StictionError(
                    f"{where}: over {s.most_bytes >> 20} MiB unpacked: expected a shorter log"
                )
            for info in archive.infolist():
                member = info.filename
                if not member.endswith(".npy"):
                    continue
                with archive.open(info) as file:
                    _check_npy(where, file, info)
                with archive.open(info) as file:
                    arrays[member.removesuffix(".npy")] = np.lib.format.read_array(
                        file, allow_pickle=False
                    )
    except StictionError:
        raise
    except Exception:
        # Damaged archives raise almost anything, from zlib.error to SyntaxError.
        inside = f", {member}" if member else ""
        raise StictionError(
            f"{where}{inside}: damaged or no NumPy archive: expected what numpy.savez writes"
        ) from None
    return arrays


def _check_npy(where: str, file: IO[bytes], info: zipfile.ZipInfo) -> None:
    """What the array says of itself must fit into its file, before any memory is taken for it."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    if dtype.hasobject:
        raise StictionError(
            f"{where}, {info.filename}: holds Python objects: expected arrays of numbers"
        )
    size = dtype.itemsize
    for length in shape:
        size *= length
    if size > info.file_size:
        raise StictionError(
            f"{where}, {info.filename}: shape {shape} does not fit into its "
            f"{info.file_size} bytes: expected what numpy.savez writes"
        )


def _read_parquet(where: str, s: FileSettings) -> dict[str, NDArray[Any]]:
    try:
        from pyarrow import parquet  # here: few logs need it, and it takes a moment
    except ImportError:
        raise missing_extra(f"{where}: reading .parquet", "pyarrow", "parquet") from None
    try:
        with parquet.ParquetFile(where) as file:
            names = file.schema_arrow.names
            if file.metadata.num_rows * len(names) > 2 * s.most_values:
                raise _too_many(where, file.metadata.num_rows, s)
            table = file.read()
        # Columns by place: names may be there twice.
        columns = [(n, table.column(i).to_numpy()) for i, n in enumerate(names)]
    except StictionError:
        raise
    except Exception:
        # pyarrow has its own exceptions, and not all derive from one class.
        raise StictionError(
            f"{where}: damaged or no Parquet file: expected a table of numbers"
        ) from None
    sort_twice = [n for i, (n, _) in enumerate(columns) if n in dict(columns[:i])]
    if sort_twice:
        raise StictionError(f"{where}: column {sort_twice[0]!r} is there twice: expected one")
    return dict(columns)
