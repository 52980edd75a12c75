"""Damaged logs of every kind: each is read whole, or refused in one line."""

import csv
import io
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.aliases import our_names
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import read_logs, read_servo_logs
from stiction_envs.measured.logs.robot_log import RobotLog
from tests.measured.logs import test_bags, test_iiwa_stack, test_lerobot, test_sage
from tests.measured.logs.bad_logs import good_values, header_of, put, text_of, torque_log
from tests.measured.logs.ros_bags import joint_states, merged, write_bag
from tests.measured.logs.test_matrices import LISTED, hdf5

VALUES = good_values(150)
CELLS = st.one_of(
    st.floats(width=32).map(repr),
    st.integers(-3, 3).map(str),
    st.sampled_from(["", "nan", "inf", "-1e999", "1_0", "0x1", "a", '"', " ", "\0", "é", "1e300"]),
)


def fuzz(examples: int) -> settings:
    return settings(
        max_examples=examples,
        deadline=5000,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


def reads_or_complains(read: Callable[[], RobotLog]) -> None:
    """Assert that a log is read into finite numbers and a rising time, or refused in one line."""
    message = ""
    try:
        log = read()
    except StictionError as error:
        message = str(error)
    else:
        assert np.all(np.diff(log.t) > 0)
        assert all(np.isfinite(x).all() for x in log.arrays if x is not None)
    assert "\n" not in message


def mat(folder: Path, **options: bool) -> None:
    content = {"t": VALUES[:, 0], "s": {"q": VALUES[:, 1:8], "tau": VALUES[:, 15:]}}
    savemat(folder / "log.mat", content, **options)


def bag(folder: Path) -> None:
    commands = test_bags.commands("/arm/joint_command", stamp=True)
    write_bag(folder / "log", "mcap", merged(joint_states(test_bags.VALUES), commands))


def sage(folder: Path) -> None:
    arrays = test_sage.TIME, test_sage.COMMAND, test_sage.ANGLES, test_sage.current()
    test_sage.write_sage(folder / "log", *(x[:80] for x in arrays))


GOOD: dict[str, tuple[Callable[[Path], object], Callable[[Path], RobotLog]]] = {
    "log.mat": (mat, torque_log),
    "log.mat, packed": (partial(mat, do_compression=True), torque_log),
    "log.mat, 7.3": (lambda f: hdf5(f / "log.mat"), torque_log),
    "log.npy": (lambda f: np.save(f / "log.npy", VALUES), partial(torque_log, columns=LISTED)),
    "log/log.mcap": (bag, test_bags.servo),
    "log.bag": (lambda f: write_bag(f / "log", "bag", test_iiwa_stack.arm()[::7]), torque_log),
    "log": (lambda f: test_lerobot.dataset(f / "log", False), test_lerobot.read),
    "log, of SAGE": (sage, test_sage.read),
}
"""By the path of the log: how a good one is made, and its reader."""


@pytest.mark.parametrize("kind", GOOD)
@fuzz(24)
@given(st.data())
def test_changed_bytes(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    make, read = GOOD[kind]
    good, path = tmp_path / "good", tmp_path / "changed"
    if not good.exists():
        good.mkdir()
        make(good)
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(good, path)
    # neither films nor what a bag's folder says of its file are read
    files = [p for p in path.rglob("*.*") if p.suffix not in (".mp4", ".yaml")]
    for file in sorted(files):
        out = bytearray(file.read_bytes())
        for _ in range(data.draw(st.integers(len(files) == 1, 6))):
            out[data.draw(st.integers(0, len(out) - 1))] = data.draw(st.integers(0, 255))
        put(file, bytes(out))
    reads_or_complains(lambda: read(path / kind.split(",")[0]))


@fuzz(80)
@given(
    st.sampled_from(["log.csv", "log.csv.gz", "log.npz", "log.parquet"]),
    st.sampled_from([b"", b"\x1f\x8b\x08\0", b"PK\x03\x04", b"PAR1", b"t,q1,q2,tau1,tau2\n"]),
    st.binary(max_size=400),
)
def test_any_bytes(tmp_path: Path, name: str, start: bytes, data: bytes) -> None:
    path = put(tmp_path / name, start + data)
    reads_or_complains(lambda: read_logs([path], 2)[0])


PLOTJUGGLER = ("__time", "/j/a1/position", "/j/a2/position", "/j/a1/effort", "/j/a2/effort")
PLOTJUGGLER += ("/j/desired/positions[0]", "/j/desired/positions[1]", "/j/a1/position/position")


@pytest.mark.parametrize(
    "names", [("t", "q1", "q2", "tau1", "tau2", "dq1", "dq2", "run"), PLOTJUGGLER]
)
@fuzz(80)
@given(
    st.data(),
    st.integers(4, 8),
    st.lists(st.lists(CELLS, min_size=6, max_size=8), max_size=12),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([read_logs, read_servo_logs]),
)
def test_any_cells(tmp_path: Path, names, data, width: int, rows, end: str, read) -> None:
    header = data.draw(st.permutations(names))
    text = end.join(",".join(row[:width]) for row in [header, *rows])
    path = put(tmp_path / "log.csv", text)
    reads_or_complains(lambda: read([path], 2)[0])


@pytest.mark.parametrize(
    ("channels", "read"),
    [
        (("q", "dq", "tau"), read_logs),
        (("q_cmd", "q", "tau", "current_abs"), read_servo_logs),
    ],
)
@fuzz(60)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 400),
    st.floats(0, 2),
    st.floats(0, 0.3),
    st.sampled_from([0.0, 1e-6, 1e-2, 1.0]),
    st.sampled_from([0.001, 0.005, 0.01, 0.02]),
    st.booleans(),
)
def test_any_numbers(
    tmp_path: Path, channels, read, seed, rows: int, jitter, holes, size, step, still: bool
) -> None:
    """Clocks that jitter, stand and leap, values that repeat and are missing."""
    rng = np.random.default_rng(seed)
    t = step * np.maximum.accumulate(np.arange(rows) + jitter * rng.normal(size=rows))
    t += rng.random() * (rng.random(rows) < 0.01).cumsum()
    v = size * rng.normal(size=(rows, 2 * len(channels))).cumsum(axis=0)
    v[rng.random(rows) < holes] = np.nan
    v[rng.random(v.shape) < holes / 20] = np.nan
    if still:
        v[rows // 3 :] = v[rows // 3]
    held = np.maximum.accumulate(np.where(rng.random(rows) < holes, 0, np.arange(rows)))
    text = text_of(np.column_stack([t, v[held]]), header_of(*channels, joints=2))
    path = put(tmp_path / "log.csv", text)
    reads_or_complains(lambda: read([path], 2)[0])


NAMES = ["t", "time [s]", "q1 [deg]", "q_2", "pos1", "effort 1", "tau[2]", "target_q1", "x pos", ""]


@fuzz(80)
@given(st.lists(st.sampled_from(NAMES) | st.text(max_size=12), max_size=9), st.integers(1, 3))
def test_any_names(names: list[str], n: int) -> None:
    """Any names give ours or one line; ours have each channel of a joint once, or as they were."""
    try:
        found = our_names("log", names, Naming(), n)
    except StictionError:
        return
    assert len(found.names) == len(names)
    taken = [x for x in found.names if x]
    assert len(set(taken)) == len(taken) or len({x.strip() for x in names}) < len(names)


@fuzz(60)
@given(
    st.lists(st.sampled_from(NAMES), min_size=5, max_size=8),
    st.sampled_from([";", "\t", " ", ","]),
    st.lists(
        st.lists(st.sampled_from(["0,1", "1.5", "nan", "", "deg", "-2"]), max_size=8), max_size=9
    ),
    st.sampled_from(["utf-8", "utf-16", "utf-16-le", "cp1252"]),
)
def test_any_dialects(
    tmp_path: Path, names: list[str], delimiter: str, rows: list[list[str]], encoding: str
) -> None:
    out = io.StringIO()
    csv.writer(out, delimiter=delimiter).writerows([names, *rows])
    path = put(tmp_path / "log.csv", out.getvalue().encode(encoding))
    reads_or_complains(lambda: read_logs([path], 2)[0])
