"""Good numbers of a log, and joint logs that are none: what the one line about each must say."""

from __future__ import annotations

import gzip
import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import JointLog, read_logs, read_servo_logs
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Limits
from tests.refusal import refusal

JOINTS = 7
ROWS = 200


def header_of(*channels: str, joints: int = JOINTS) -> str:
    """Header of a log with these channels of each joint."""
    return ",".join(["t", *(f"{c}{j}" for c in channels for j in range(1, joints + 1))])


HEADER = header_of("q", "dq", "tau")


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


def torque_log(
    path: Path, n: int = JOINTS, *, limits: Limits | None = None, **naming: object
) -> JointLog:
    return read_logs([path], n, limits=limits, naming=Naming(**naming))[0]


def servo_log(
    path: Path, n: int = JOINTS, *, limits: Limits | None = None, **naming: object
) -> ServoLog:
    return read_servo_logs([path], n, limits=limits, naming=Naming(**naming))[0]


def assert_holds(
    log: JointLog | ServoLog, values: np.ndarray, names: str = "t q dq tau", **within: float
) -> None:
    """A log has these channels of ``t, q, dq, tau`` (T, 1 + 3n), to the bit or within ``atol``."""
    t, *rest = np.split(values, 1 + log.n * np.arange(3), axis=1)
    expected = dict(zip(("t", "q", "dq", "tau"), (t[:, 0], *rest), strict=True))
    for name in names.split():
        tolerance = {"rtol": 0.0, "atol": 0.0, **within}
        np.testing.assert_allclose(getattr(log, name), expected[name], err_msg=name, **tolerance)


def put(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refuses(read: Callable[[], object], says: str) -> str:
    """Return the one line that refuses a file, with the pattern ``says`` and what is expected."""
    message = refusal(read, says)
    assert "expected" in message
    return message


def changed(change: Callable[[np.ndarray], None]) -> str:
    """A good log with other numbers."""
    values = good_values()
    change(values)
    return text_of(values)


def _set(rows: object, columns: object, value: object) -> str:
    return changed(lambda values: values.__setitem__((rows, columns), value))


def _scaled(columns: slice, factor: float) -> str:
    return _set(slice(None), columns, good_values()[:, columns] * factor)


def _line(number: int, change: Callable[[str], str]) -> str:
    """A good log with one other line; line 1 is the header."""
    lines = GOOD.splitlines()
    lines[number - 1] = change(lines[number - 1])
    return "\n".join(lines) + "\n"


def _header(old: str, new: str) -> str:
    return _line(1, lambda line: line.replace(old, new, 1))


def _cell(row: int, column: str, value: str) -> str:
    def change(line: str) -> str:
        cells = line.split(",")
        cells[HEADER.split(",").index(column)] = value
        return ",".join(cells)

    return _line(row, change)


def _npz(**other: np.ndarray | None) -> bytes:
    v, out = good_values(), io.BytesIO()
    arrays = {"t": v[:, 0], "q": v[:, 1:8], "tau": v[:, 15:]} | other
    np.savez(out, **{k: a for k, a in arrays.items() if a is not None})
    return out.getvalue()


def _lying_npz() -> bytes:
    """A member whose header claims a terabyte."""
    member, out = io.BytesIO(), io.BytesIO()
    head = {"descr": "<f8", "fortran_order": False, "shape": (10**11, 7)}
    np.lib.format.write_array_header_1_0(member, head)
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("q.npy", member.getvalue() + b"\0" * 64)
    return out.getvalue()


def _percent(values: np.ndarray) -> None:
    # Per cent of 87 and 12 N·m.
    values[:, 15:] = 40 + 30 * np.sin(np.arange(len(values)))[:, None]


def _small_degrees(values: np.ndarray) -> None:
    # Within twice the limits of position, but six times too fast.
    values[:, 1:8] += 1.2 * np.sin(12 * values[:, :1])


VALUES = good_values()
GOOD = text_of(VALUES)
ZIPPED = gzip.compress(GOOD.encode(), mtime=0)
GARBAGE = bytes(np.random.default_rng(0).integers(0, 256, 5000, np.uint8))
ALL = slice(None)
Q, DQ, TAU = slice(1, 8), slice(8, 15), slice(15, 22)
SIX = text_of(good_values(joints=6), header_of("q", "dq", "tau", joints=6))
CONSTANT = changed(lambda values: values.__setitem__((ALL, slice(1, None)), values[0, 1:]))
BACKWARDS = changed(lambda values: values.__setitem__((ALL, 0), values[::-1, 0].copy()))

BAD_CSV: dict[str, tuple[str, str | bytes]] = {
    "empty file": (r"log\.csv: empty file: expected a header", ""),
    "header only": (r"log\.csv: no rows below", HEADER + "\n"),
    "wrong joint count": (r"columns for 6 joints, but the robot has 7: expected t,q1\.\.q7", SIX),
    "no time": (r"log\.csv: missing column 't' \(time in s\)", _header("t,", "uhr,")),
    "missing column": (r"log\.csv: missing column 'tau4'", _header("tau4", "moment_four")),
    "duplicate column": (r"log\.csv: column 'q3' is there twice", _header("q4", "q3")),
    "no header": (r"log\.csv, line 1: numbers without a header", GOOD.split("\n", 1)[1]),
    "decimal commas between commas": (
        r"line 2: 4\d values: .* 22 columns; decimal commas need semicolons",
        HEADER + "\n" + GOOD.split("\n", 1)[1].replace(".", ","),
    ),
    "unknown unit": (
        r"column 'q2 \[furlong\]': unknown unit 'furlong'",
        _header("q2", "q2 [furlong]"),
    ),
    "two names for one": (
        r"columns 'pos_1' and 'position_1' may both be q1: expected one; say which",
        _line(1, lambda x: x.replace("q1", "pos_1", 1).replace("q2", "position_1", 1)),
    ),
    "a pointer of Git LFS": (
        r"log\.csv: a pointer of Git LFS .* run `git lfs pull`",
        "version https://git-lfs.github.com/spec/v1\noid sha256:48de\nsize 1\n",
    ),
    "text in a cell": (r"line 50: tau2 is 'high': expected numbers", _cell(50, "tau2", "high")),
    "below blank lines": (r"line 52: q1 is 'x'", _cell(50, "q1", "x").replace("\n", "\n\n  \n", 1)),
    "underscore in a number": (r"line 7: q5 is '1_000'", _cell(7, "q5", "1_000")),
    "infinity": (r"line 60: q3 is inf: expected finite numbers", _cell(60, "q3", "inf")),
    "time missing": (r"line 63: t is nan", _cell(63, "t", "")),
    "huge value": (
        r"line 64: tau6 is 1e\+300: expected up to 100000 N·m",
        _cell(64, "tau6", "1e300"),
    ),
    "time falls": (r"line 3: t falls from 1\.99 to 1\.98: expected time that rises", BACKWARDS),
    "milliseconds": (
        r"t rises by 10 from row to row, it looks like milliseconds",
        _scaled(slice(0, 1), 1e3),
    ),
    "shorter than a second": (
        r"0\.29 s of samples: expected 1 s or more",
        text_of(good_values(rows=30)),
    ),
    "all constant": (r"q1\.\.q7 and tau1\.\.tau7 never change", CONSTANT),
    "degrees": (
        r"line \d+: q\d is -?\d+\.\d+, which looks like degrees: expected .* rad",
        _scaled(slice(1, 15), 180 / np.pi),
    ),
    "small angles in degrees": (
        r"q\d moves at .* can do 2\.\d+ rad/s \(stated by .*, which looks like degrees: expected",
        changed(_small_degrees),
    ),
    "speeds in degrees": (
        r"dq is 57\.\d times the derivative of q, which looks like degrees per second",
        _scaled(DQ, 180 / np.pi),
    ),
    "per cent": (
        r"line \d+: tau5 is .* looks like per cent .* this joint can do 12",
        changed(_percent),
    ),
    "millinewton metres": (r"tau\d is .* looks like mN·m", _scaled(TAU, 1e3)),
    "a column without values": (
        r"line 2: q2 has no value, in 200 of 200 rows",
        _set(ALL, 2, np.nan),
    ),
    "no values at all": (r"no row has values", _set(ALL, slice(1, 22), np.nan)),
    "a row with too few values": (
        r"line 20: 21 values: expected one for each of the 22",
        _line(20, lambda line: line.rsplit(",", 1)[0]),
    ),
    "binary garbage": (r"log\.csv, line 1: ", GARBAGE),
    "half a letter": (r"no UTF-16 after line \d+", GOOD.encode("utf-16")[:2001]),
    "endless line": (r"a line of over 65536 bytes", "1," * 200_000),
    "compressed but named csv": (r"gzip-compressed: expected the name \.csv\.gz", ZIPPED),
}
BAD_GZIP: dict[str, tuple[str, str | bytes]] = {
    "not gzip": (r"log\.csv\.gz: not gzip", GOOD),
    "compressed file cut short": (
        r"log\.csv\.gz: the compressed file ends early after line 1\d\d:",
        ZIPPED[:-2000],
    ),
    "compressed file damaged": (
        r"log\.csv\.gz: the compressed file (is damaged|ends early) after line \d+:",
        ZIPPED[:3000] + b"\xff" * 4000,
    ),
}
BAD_NPZ: dict[str, tuple[str, str | bytes]] = {
    "npz cut short": (r"damaged or no NumPy archive", _npz()[:-700]),
    "npz with shorter torques": (
        r"column 'tau1' has 50 rows, 't' has 200",
        _npz(tau=good_values()[:50, 15:]),
    ),
    "npz with deep arrays": (r"missing columns 'q1', 'q2'", _npz(q=np.ones((200, 7, 2)))),
    "npz with text": (r"column 'q1' holds <U3: expected numbers", _npz(q=np.full((200, 7), "one"))),
    "npz with objects": (r"damaged .* expected numbers", _npz(q=np.full((200, 7), None))),
    "npz that claims a terabyte": (r"damaged or no NumPy archive", _lying_npz()),
}
BAD_FILES = {
    **{k: (*v, "log.csv") for k, v in BAD_CSV.items()},
    **{k: (*v, "log.csv.gz") for k, v in BAD_GZIP.items()},
    **{k: (*v, "log.npz") for k, v in BAD_NPZ.items()},
    "unknown kind": (
        r"log\.xlsx: unknown kind of file: expected one of \.csv, \.csv\.gz, \.tsv",
        GOOD,
        "log.xlsx",
    ),
    "no parquet": (r"log\.parquet: damaged or no Parquet", b"PAR1 no table PAR1", "log.parquet"),
}
"""By what is wrong: what the one line must match, the content, the name of the file."""
