"""Good numbers of a log, and joint logs that are none: what the one line about each must say."""

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
LFS_POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:48de\nsize 1\n"


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


def _with(columns: int | slice, value: object) -> str:
    """Return a good log with other numbers in some columns."""
    values = VALUES.copy()
    values[:, columns] = value
    return text_of(values)


def _cell(number: int, column: str, text: str) -> str:
    """Return a good log with another cell in a line; line 1 is the header."""
    lines = [line.split(",") for line in GOOD.splitlines()]
    lines[number - 1][lines[0].index(column)] = text
    return "\n".join(map(",".join, lines)) + "\n"


def _npz(**other: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez(out, **{"t": VALUES[:, 0], "q": VALUES[:, Q], "tau": VALUES[:, TAU], **other})
    return out.getvalue()


def _lying_npz() -> bytes:
    """Return an archive whose member claims a terabyte."""
    member, out = io.BytesIO(), io.BytesIO()
    head = {"descr": "<f8", "fortran_order": False, "shape": (10**11, 7)}
    np.lib.format.write_array_header_1_0(member, head)
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("q.npy", member.getvalue() + b"\0" * 64)
    return out.getvalue()


VALUES = good_values()
GOOD = text_of(VALUES)
ROW_20 = GOOD.splitlines()[19]
ZIPPED = gzip.compress(GOOD.encode(), mtime=0)
GARBAGE = bytes(np.random.default_rng(0).integers(0, 256, 5000, np.uint8))
T, Q, DQ, TAU = slice(0, 1), slice(1, 8), slice(8, 15), slice(15, 22)
DEGREE = 180 / np.pi
SIX = text_of(good_values(joints=6), header_of("q", "dq", "tau", joints=6))
# within twice the limits of position, but six times too fast
SMALL_DEGREES = VALUES[:, Q] + 1.2 * np.sin(12 * VALUES[:, T])
PER_CENT = 40 + 30 * np.sin(np.arange(ROWS))[:, None]
"""Per cent of 87 and 12 N·m."""

BAD_FILES: dict[str, dict[str, str | bytes]] = {
    "log.csv": {
        r"log\.csv: empty file: expected a header": "",
        r"log\.csv: no rows below": HEADER + "\n",
        r"columns for 6 joints, but the robot has 7: expected t,q1\.\.q7": SIX,
        r"log\.csv: missing column 't' \(time in s\)": GOOD.replace("t,", "uhr,", 1),
        r"log\.csv: missing column 'tau4'": GOOD.replace("tau4", "moment_four", 1),
        r"log\.csv: column 'q3' is there twice": GOOD.replace("q4", "q3", 1),
        r"log\.csv, line 1: numbers without a header": GOOD.split("\n", 1)[1],
        r"line 2: 4\d values: .* 22 columns; decimal commas need semicolons": (
            HEADER + "\n" + GOOD.split("\n", 1)[1].replace(".", ",")
        ),
        r"column 'q2 \[furlong\]': unknown unit 'furlong'": GOOD.replace("q2", "q2 [furlong]", 1),
        r"columns 'pos_1' and 'position_1' may both be q1: expected one; say which": (
            GOOD.replace("q1", "pos_1", 1).replace("q2", "position_1", 1)
        ),
        r"log\.csv: a pointer of Git LFS .* run `git lfs pull`": LFS_POINTER,
        r"line 50: tau2 is 'high': expected numbers": _cell(50, "tau2", "high"),
        # below blank lines
        r"line 52: q1 is 'x'": _cell(50, "q1", "x").replace("\n", "\n\n  \n", 1),
        r"line 7: q5 is '1_000'": _cell(7, "q5", "1_000"),
        r"line 60: q3 is inf: expected finite numbers": _cell(60, "q3", "inf"),
        r"line 63: t is nan": _cell(63, "t", ""),
        r"line 64: tau6 is 1e\+300: expected up to 100000 N·m": _cell(64, "tau6", "1e300"),
        r"line 3: t falls from 1\.99 to 1\.98: expected time that rises": _with(T, VALUES[::-1, T]),
        r"t rises by 10 from row to row, it looks like milliseconds": _with(T, 1e3 * VALUES[:, T]),
        r"0\.29 s of samples: expected 1 s or more": text_of(good_values(rows=30)),
        r"q1\.\.q7 and tau1\.\.tau7 never change": _with(slice(1, None), VALUES[0, 1:]),
        r"line \d+: q\d is -?\d+\.\d+, which looks like degrees: expected .* rad": (
            _with(slice(1, 15), DEGREE * VALUES[:, 1:15])
        ),
        r"q\d moves at .* can do 2\.\d+ rad/s \(stated by .*, which looks like degrees: expected": (
            _with(Q, SMALL_DEGREES)
        ),
        r"dq is 57\.\d times the derivative of q, which looks like degrees per second": (
            _with(DQ, DEGREE * VALUES[:, DQ])
        ),
        r"line \d+: tau5 is .* looks like per cent .* this joint can do 12": _with(TAU, PER_CENT),
        r"tau\d is .* looks like mN·m": _with(TAU, 1e3 * VALUES[:, TAU]),
        r"line 2: q2 has no value, in 200 of 200 rows": _with(2, np.nan),
        r"no row has values": _with(slice(1, None), np.nan),
        r"line 20: 21 values: expected one for each of the 22": (
            GOOD.replace(ROW_20, ROW_20.rsplit(",", 1)[0])
        ),
        r"log\.csv, line 1: ": GARBAGE,
        r"no UTF-16 after line \d+": GOOD.encode("utf-16")[:2001],
        r"a line of over 65536 bytes": "1," * 200_000,
        r"gzip-compressed: expected the name \.csv\.gz": ZIPPED,
    },
    "log.csv.gz": {
        r"log\.csv\.gz: not gzip": GOOD,
        r"log\.csv\.gz: the compressed file ends early after line 1\d\d:": ZIPPED[:-2000],
        r"log\.csv\.gz: the compressed file (is damaged|ends early) after line \d+:": (
            ZIPPED[:3000] + b"\xff" * 4000
        ),
    },
    "log.npz": {
        r"log\.npz: damaged or no NumPy archive": _npz()[:-700],
        r"damaged or no NumPy archive": _lying_npz(),
        r"column 'tau1' has 50 rows, 't' has 200": _npz(tau=VALUES[:50, TAU]),
        r"missing columns 'q1', 'q2'": _npz(q=np.ones((200, 7, 2))),
        r"column 'q1' holds <U3: expected numbers": _npz(q=np.full((200, 7), "one")),
        r"damaged .* expected numbers": _npz(q=np.full((200, 7), None)),
    },
    "log.xlsx": {
        r"log\.xlsx: unknown kind of file: expected one of \.csv, \.csv\.gz, \.tsv": GOOD,
    },
    "log.parquet": {r"log\.parquet: damaged or no Parquet": b"PAR1 no table PAR1"},
}
"""By the name of the file: what the one line about it must match, and the content."""
