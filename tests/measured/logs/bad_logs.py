"""Joint logs that are none: what is wrong with each, and what its one line must say.

Used by the tests of the reader, and by those of the command line, which must exit with code 2 and
write nothing for every one of them.
"""

from __future__ import annotations

import gzip
import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

JOINTS = 7
ROWS = 200
HEADER = "t," + ",".join(f"{c}{j}" for c in ("q", "dq", "tau") for j in range(1, JOINTS + 1))


def good_values(rows: int = ROWS, joints: int = JOINTS, rate: float = 100.0) -> np.ndarray:
    """t, q, dq and tau of an arm that sways, (rows, 1 + 3 joints); a Panda could do it."""
    rng = np.random.default_rng(3)
    t = np.arange(rows) / rate
    omega = 1.5 + 0.1 * np.arange(joints)
    middle = np.array([0, 0, 0, -1.5, 0, 1.5, 0, 0, 0])[:joints]
    q = middle + 0.4 * np.sin(np.outer(t, omega))
    dq = 0.4 * omega * np.cos(np.outer(t, omega))
    tau = 3 * np.sin(q) + 0.05 * rng.normal(size=q.shape)
    q, dq = q + 1e-5 * rng.normal(size=q.shape), dq + 1e-3 * rng.normal(size=q.shape)
    return np.column_stack([t, q, dq, tau])


def text_of(values: np.ndarray, header: str = HEADER) -> str:
    """CSV text."""
    out = io.StringIO()
    np.savetxt(out, values, delimiter=",", fmt="%.9g", header=header, comments="")
    return out.getvalue()


def header_of(joints: int) -> str:
    """Header of a log of another robot."""
    return "t," + ",".join(f"{c}{j}" for c in ("q", "dq", "tau") for j in range(1, joints + 1))


@dataclass(frozen=True)
class BadLog:
    """A folder with one or more files of which at least one is no log."""

    name: str
    says: str
    """Regular expression that the message must contain."""
    write: Callable[[Path], list[Path]]
    """Writes the files into a folder; their paths."""


def _file(name: str, content: Callable[[], bytes | str]) -> Callable[[Path], list[Path]]:
    def write(folder: Path) -> list[Path]:
        data = content()
        path = folder / name
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        return [path]

    return write


def _csv(change: Callable[[np.ndarray], None]) -> Callable[[Path], list[Path]]:
    """A good log with changed numbers."""

    def content() -> str:
        values = good_values()
        change(values)
        return text_of(values)

    return _file("log.csv", content)


def _lines(change: Callable[[list[str]], None]) -> Callable[[Path], list[Path]]:
    """A good log with changed lines; line 1 is the header."""

    def content() -> str:
        lines = text_of(good_values()).splitlines()
        change(lines)
        return "\n".join(lines) + "\n"

    return _file("log.csv", content)


def _cell(row: int, column: str, value: str) -> Callable[[Path], list[Path]]:
    """A good log with one other cell, in the line ``row``."""

    def change(lines: list[str]) -> None:
        cells = lines[row - 1].split(",")
        cells[HEADER.split(",").index(column)] = value
        lines[row - 1] = ",".join(cells)

    return _lines(change)


def _npz(**arrays: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _good_npz(**other: np.ndarray) -> bytes:
    v = good_values()
    arrays = {"t": v[:, 0], "q": v[:, 1:8], "tau": v[:, 15:]} | other
    return _npz(**{k: a for k, a in arrays.items() if a is not None})


def _lying_npz() -> bytes:
    """A member whose header claims a terabyte."""
    member = io.BytesIO()
    head = {"descr": "<f8", "fortran_order": False, "shape": (10**11, 7)}
    np.lib.format.write_array_header_1_0(member, head)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("q.npy", member.getvalue() + b"\0" * 64)
    return out.getvalue()


def _set(rows: object, columns: object, value: object) -> Callable[[np.ndarray], None]:
    def change(values: np.ndarray) -> None:
        values[rows, columns] = value

    return change


def _scale(columns: slice, factor: float) -> Callable[[np.ndarray], None]:
    def change(values: np.ndarray) -> None:
        values[:, columns] *= factor

    return change


def _shift_time(values: np.ndarray) -> None:
    values[:, 0] = values[::-1, 0].copy()


def _all_constant(values: np.ndarray) -> None:
    values[:, 1:] = values[0, 1:]


def _two_robots(folder: Path) -> list[Path]:
    paths = [folder / "seven.csv", folder / "six.csv"]
    paths[0].write_text(text_of(good_values()))
    paths[1].write_text(text_of(good_values(joints=6), header_of(6)))
    return paths


def _twice(folder: Path) -> list[Path]:
    paths = [folder / "one.csv", folder / "copy.csv"]
    for path in paths:
        path.write_text(text_of(good_values()))
    return paths


def _folder(folder: Path) -> list[Path]:
    (folder / "log.csv").mkdir()
    return [folder / "log.csv"]


def _zipped(text: str) -> bytes:
    return gzip.compress(text.encode(), mtime=0)


def _percent(values: np.ndarray) -> None:
    # Per cent of 87 and 12 N·m.
    values[:, 15:] = 40 + 30 * np.sin(np.arange(len(values)))[:, None]


def _small_degrees(values: np.ndarray) -> None:
    # Within twice the limits of position, but six times too fast.
    values[:, 1:8] += 1.2 * np.sin(12 * values[:, :1])


Q, DQ, TAU = slice(1, 8), slice(8, 15), slice(15, 22)

BAD_LOGS = (
    BadLog("empty file", r"log\.csv: empty file: expected a header", _file("log.csv", bytes)),
    BadLog("only blank lines", r"log\.csv: empty file", _file("log.csv", lambda: "\n\r\n\n")),
    BadLog("header only", r"log\.csv: no rows below", _file("log.csv", lambda: HEADER + "\n")),
    BadLog("missing file", r"gone\.csv: no such file", lambda folder: [folder / "gone.csv"]),
    BadLog("directory", r"log\.csv: a directory: expected a log file", _folder),
    BadLog("device", r"/dev/zero: no regular file", lambda folder: [Path("/dev/zero")]),
    BadLog(
        "unknown kind",
        r"log\.xlsx: unknown kind of file: expected one of \.csv, \.csv\.gz, \.npz, \.parquet",
        _file("log.xlsx", lambda: text_of(good_values())),
    ),
    BadLog(
        "wrong joint count",
        r"columns for 6 joints, but the robot has 7: expected t,q1\.\.q7",
        _file("log.csv", lambda: text_of(good_values(joints=6), header_of(6))),
    ),
    BadLog(
        "too many joints",
        r"columns for 8 joints, but the robot has 7",
        _file("log.csv", lambda: text_of(good_values(joints=8), header_of(8))),
    ),
    BadLog("two robots", r"six\.csv: columns for 6 joints, but the robot has 7", _two_robots),
    BadLog("the same log twice", r"copy\.csv: the same log as .*one\.csv", _twice),
    BadLog(
        "no time",
        r"log\.csv: missing column 't' \(time in s\)",
        _lines(lambda lines: lines.__setitem__(0, HEADER.replace("t,", "time,", 1))),
    ),
    BadLog(
        "missing column",
        r"log\.csv: missing column 'tau4'",
        _lines(lambda lines: lines.__setitem__(0, HEADER.replace("tau4", "torque4"))),
    ),
    BadLog(
        "one speed missing",
        r"log\.csv: missing column 'dq2'",
        _lines(lambda lines: lines.__setitem__(0, HEADER.replace("dq2", "velocity2"))),
    ),
    BadLog(
        "duplicate column",
        r"log\.csv: column 'q3' is there twice",
        _lines(lambda lines: lines.__setitem__(0, HEADER.replace("q4", "q3", 1))),
    ),
    BadLog(
        "joints from zero",
        r"column 'q0', but joints count from 1",
        _lines(
            lambda lines: lines.__setitem__(
                0, "t," + ",".join(f"{c}{j}" for c in ("q", "dq", "tau") for j in range(7))
            )
        ),
    ),
    BadLog(
        "no header",
        r"log\.csv: missing column 't'",
        _file("log.csv", lambda: text_of(good_values()).split("\n", 1)[1]),
    ),
    BadLog(
        "semicolons",
        r"log\.csv: missing column 't'",
        _file("log.csv", lambda: text_of(good_values()).replace(",", ";")),
    ),
    BadLog(
        "text in a cell", r"line 50: tau2 is 'high': expected numbers", _cell(50, "tau2", "high")
    ),
    BadLog("decimal comma", r"line 9: q1 is '0\.1\.2'", _cell(9, "q1", "0.1.2")),
    BadLog("underscore in a number", r"line 7: q5 is '1_000'", _cell(7, "q5", "1_000")),
    BadLog("infinity", r"line 60: q3 is inf: expected finite numbers", _cell(60, "q3", "inf")),
    BadLog("negative infinity", r"line 61: tau1 is -inf", _cell(61, "tau1", "-Infinity")),
    BadLog("infinite time", r"line 62: t is inf", _cell(62, "t", "inf")),
    BadLog("time missing", r"line 63: t is nan", _cell(63, "t", "")),
    BadLog(
        "huge value",
        r"line 64: tau6 is 1e\+300: expected up to 100000 N·m",
        _cell(64, "tau6", "1e300"),
    ),
    BadLog("overflow", r"line 65: dq6 is inf", _cell(65, "dq6", "1e999")),
    BadLog(
        "time falls",
        r"line 3: t falls from 1\.99 to 1\.98: expected time that rises",
        _csv(_shift_time),
    ),
    BadLog("one negative step", r"line 81: t falls from 0\.78 to 0\.3", _cell(81, "t", "0.3")),
    BadLog("time stands", r"t never rises", _csv(_set(slice(None), 0, 4.0))),
    BadLog(
        "milliseconds",
        r"t rises by 10 from row to row, it looks like milliseconds",
        _csv(_scale(slice(0, 1), 1e3)),
    ),
    BadLog("nanoseconds", r"it looks like nanoseconds", _csv(_scale(slice(0, 1), 1e9))),
    BadLog("too slow", r"t rises by 0\.2 from row to row", _csv(_scale(slice(0, 1), 20))),
    BadLog(
        "shorter than a second",
        r"0\.29 s of samples: expected 1 s or more",
        _file("log.csv", lambda: text_of(good_values(rows=30))),
    ),
    BadLog("one row", r"log\.csv", _file("log.csv", lambda: text_of(good_values(rows=1)))),
    BadLog("all constant", r"q1\.\.q7 and tau1\.\.tau7 never change", _csv(_all_constant)),
    BadLog("no torque", r"tau1\.\.tau7 never change", _csv(_set(slice(None), TAU, 0.0))),
    BadLog(
        "degrees",
        r"line \d+: q\d is -?\d+\.\d+, which looks like degrees: expected .* rad",
        _csv(_scale(slice(1, 15), 180 / np.pi)),
    ),
    BadLog(
        "small angles in degrees",
        r"q\d moves at .* the joint can do 2\.\d+: expected angles in rad, not degrees",
        _csv(_small_degrees),
    ),
    BadLog(
        "speeds in degrees",
        r"dq is 57\.\d times the derivative of q, which looks like degrees per second",
        _csv(_scale(DQ, 180 / np.pi)),
    ),
    BadLog(
        "per cent",
        r"line \d+: tau5 is .* looks like per cent .* this joint can do 12",
        _csv(_percent),
    ),
    BadLog("millinewton metres", r"tau\d is .* looks like mN·m", _csv(_scale(TAU, 1e3))),
    BadLog(
        "a column without values",
        r"line 2: q2 has no value, in 200 of 200 rows",
        _csv(_set(slice(None), 2, np.nan)),
    ),
    BadLog(
        "many missing values",
        r"line 12: tau3 has no value, in 40 of 200 rows",
        _csv(_set(slice(10, 50), 17, np.nan)),
    ),
    BadLog("no values at all", r"no row has values", _csv(_set(slice(None), slice(1, 22), np.nan))),
    BadLog(
        "a row with too few values",
        r"line 20: 21 values: expected one for each of the 22",
        _lines(lambda lines: lines.__setitem__(19, lines[19].rsplit(",", 1)[0])),
    ),
    BadLog(
        "a row with too many values",
        r"line 21: 23 values",
        _lines(lambda lines: lines.__setitem__(20, lines[20] + ",1")),
    ),
    BadLog(
        "cut in the middle of a row",
        r"line 201: \d+ values",
        _file("log.csv", lambda: text_of(good_values())[:-100]),
    ),
    BadLog(
        "binary garbage",
        r"log\.csv, line 1: ",
        _file("log.csv", lambda: bytes(np.random.default_rng(0).integers(0, 256, 5000, np.uint8))),
    ),
    BadLog(
        "wrong encoding",
        r"line 1: byte 0 is not UTF-8",
        _file("log.csv", lambda: text_of(good_values()).encode("utf-16")),
    ),
    BadLog("null bytes", r"line 1: not text", _file("log.csv", lambda: "\0" * 1000)),
    BadLog("endless line", r"a line of over 65536 bytes", _file("log.csv", lambda: "1," * 200_000)),
    BadLog(
        "compressed but named csv",
        r"gzip-compressed: expected the name \.csv\.gz",
        _file("log.csv", lambda: _zipped(text_of(good_values()))),
    ),
    BadLog(
        "not gzip", r"log\.csv\.gz: not gzip", _file("log.csv.gz", lambda: text_of(good_values()))
    ),
    BadLog("empty gzip", r"log\.csv\.gz: empty file", _file("log.csv.gz", bytes)),
    BadLog(
        "compressed file cut short",
        r"log\.csv\.gz: the compressed file ends early after line 1\d\d:",
        _file("log.csv.gz", lambda: _zipped(text_of(good_values()))[:-2000]),
    ),
    BadLog(
        "compressed file damaged",
        r"log\.csv\.gz: the compressed file (is damaged|ends early) after line \d+:",
        _file("log.csv.gz", lambda: _zipped(text_of(good_values()))[:3000] + b"\xff" * 4000),
    ),
    BadLog(
        "npz that is none",
        r"damaged or no NumPy archive",
        _file("log.npz", lambda: b"PK\x03\x04 no archive"),
    ),
    BadLog(
        "npz cut short",
        r"damaged or no NumPy archive",
        _file("log.npz", lambda: _good_npz()[:-700]),
    ),
    BadLog(
        "npz without angles",
        r"missing columns 'q1', 'q2'",
        _file("log.npz", lambda: _good_npz(q=None)),
    ),
    BadLog(
        "npz with other names", r"missing column 't'", _file("log.npz", lambda: _npz(a=np.zeros(3)))
    ),
    BadLog(
        "npz with shorter torques",
        r"column 'tau1' has 50 rows, 't' has 200",
        _file("log.npz", lambda: _good_npz(tau=good_values()[:50, 15:])),
    ),
    BadLog(
        "npz of six joints",
        r"columns for 6 joints",
        _file("log.npz", lambda: _good_npz(q=np.ones((200, 6)), tau=np.ones((200, 6)))),
    ),
    BadLog(
        "npz with deep arrays",
        r"missing columns 'q1', 'q2'",
        _file("log.npz", lambda: _good_npz(q=np.ones((200, 7, 2)))),
    ),
    BadLog(
        "npz with text",
        r"column 'q1' holds <U3: expected numbers",
        _file("log.npz", lambda: _good_npz(q=np.full((200, 7), "one"))),
    ),
    BadLog(
        "npz with complex numbers",
        r"column 'tau1' holds complex128",
        _file("log.npz", lambda: _good_npz(tau=np.ones((200, 7), complex))),
    ),
    BadLog(
        "npz with objects",
        r"q\.npy: holds Python objects",
        _file("log.npz", lambda: _good_npz(q=np.full((200, 7), None))),
    ),
    BadLog(
        "npz that claims a terabyte",
        r"q\.npy: shape \(100000000000, 7\) does not fit",
        _file("log.npz", _lying_npz),
    ),
    BadLog(
        "no parquet",
        r"log\.parquet: damaged or no Parquet",
        _file("log.parquet", lambda: b"PAR1 no table PAR1"),
    ),
)
