"""Servo logs: commanded and measured positions, in every kind of file, good and damaged."""

import gzip
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.reader import drive_of
from stiction_envs.measured.logs.robot_log import JointLog
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import DEGREE, GOOD, header_of, put, refuses, servo_log, text_of
from tests.measured.logs.test_robot_logs import real
from tests.refusal import refusal

N = 7
read = partial(servo_log, limits=load_arm("panda").limits)
STEP = 2 * np.pi / 4096


HEADER = header_of("q_cmd", "q")


def servo_values(rows: int = 250, rate: float = 50.0) -> np.ndarray:
    """Return t, q_cmd, q (rows, 15) in encoder steps of servos that rest until a large command."""
    t = np.arange(rows) / rate
    middle = np.array([0, 0, 0, -1.5, 0, 1.5, 0])
    command = middle + 0.3 * np.sin(np.outer(t, 1.5 + 0.1 * np.arange(N)))
    q, stands = np.empty_like(command), command[0]
    for k, told in enumerate(command):
        stands = np.clip(stands, told - 0.03, told + 0.03)
        q[k] = STEP * np.round(stands / STEP)
    return np.column_stack([t, command, q])


def test_steps_of_the_encoder_and_rest_are_kept_to_the_bit(tmp_path: Path) -> None:
    """Most rows hold some joint that has not moved: no repeat, no old channel."""
    path = put(tmp_path / "log.csv", text_of(servo_values(), HEADER))
    shown = np.loadtxt(path, delimiter=",", skiprows=1)
    assert (np.diff(shown[:, 8:], axis=0) == 0).mean() > 0.1
    log = read(path)
    assert np.array_equal(log.t, shown[:, 0])
    assert np.array_equal(log.q_cmd, shown[:, 1:8])
    assert np.array_equal(log.q, shown[:, 8:])
    assert (log.dq, log.tau, log.current, log.extra) == (None, None, None, {})
    assert (log.corrections, log.warnings, log.breaks) == ((), (), ())
    assert (log.n, log.drive, log.source) == (N, "position", str(path))
    assert log.step == pytest.approx(0.02)
    assert not log.q_cmd.flags.writeable


def test_channels_that_may_be_there(tmp_path: Path) -> None:
    """Sizes of currents, which stay at 0 for long, are not called saturated."""
    v = servo_values()
    dq = np.gradient(v[:, 8:], v[:, 0], axis=0)
    tau = np.sin(3 * v[:, :1] + np.arange(N))
    header = header_of("q_cmd", "q", "dq", "tau", "current_torque_abs", "temperature")
    values = np.column_stack([v, dq, tau, np.maximum(tau, 0), 30 + tau])
    log = read(put(tmp_path / "log.csv", text_of(values, header)))
    assert log.dq == pytest.approx(dq, abs=1e-6)
    assert log.tau == pytest.approx(tau, abs=1e-8)
    assert log.current == pytest.approx(np.maximum(tau, 0), abs=1e-8)
    assert log.extra["temperature"] == pytest.approx(30 + tau)
    assert log.warnings == ()
    (note,) = log.corrections
    assert note.text == (
        "columns by other names: current_torque_abs1 to current_torque_abs7 are current_abs1 to "
        "current_abs7"
    )
    header = header_of("q_cmd", "q", "current_abs")
    log = read(put(tmp_path / "signed.csv", text_of(np.column_stack([v, -tau]), header)))
    assert log.current == pytest.approx(np.abs(tau), abs=1e-8)
    assert log.warnings == ("current_abs1 is negative in places: its size is used",)


def test_jitter_and_dates(tmp_path: Path) -> None:
    """Stamps of a PC stay as they are; equal ones are made to rise."""
    v = servo_values()
    v[:, 0] += 1.7e9 + 0.003 * np.random.default_rng(0).random(len(v))
    v[100, 0] = v[99, 0]
    np.savez(tmp_path / "log.npz", t=v[:, 0], q_cmd=v[:, 1:8], q=v[:, 8:])
    log = read(tmp_path / "log.npz")
    assert log.date == v[0, 0]
    assert [c.kind for c in log.corrections] == ["epoch", "stamp"]
    assert log.t == pytest.approx(np.delete(v[:, 0], 100) - v[0, 0], abs=1e-6)


def test_drive(tmp_path: Path) -> None:
    v = servo_values()
    both = text_of(np.column_stack([v, v[:, 1:8]]), header_of("q_cmd", "q", "tau"))
    neither = text_of(v[:, [0, *range(8, 15)]], header_of("q"))
    assert drive_of(put(tmp_path / "servo.csv", text_of(v, HEADER))) == "position"
    assert drive_of(put(tmp_path / "joint.csv", GOOD)) == "torque"
    assert drive_of(put(tmp_path / "both.csv", both)) == "torque"
    assert drive_of(read(tmp_path / "servo.csv")) == "position"
    t, q = v[:, 0], v[:, 8:]
    assert drive_of(JointLog(source="x", t=t, q=q, dq=None, tau=q.copy())) == "torque"
    path = put(tmp_path / "neither.csv", neither)
    refuses(lambda: drive_of(path), "neither torques nor commanded positions: expected")
    assert len(check(path).findings) == 1
    (found,) = [x for x in check(tmp_path / "both.csv").findings if x.kind == "remark"]
    assert "columns not used: 'q_cmd1'" in found.message
    assert not check(tmp_path / "both.csv", drive="position").findings
    refusal(lambda: check(tmp_path / "both.csv", drive="hydraulic"), "drive")


COMMANDS, ANGLES, BOTH = slice(1, 8), slice(8, 15), slice(1, 15)


def scaled(columns: slice, factor: float) -> str:
    values = servo_values()
    values[:, columns] *= factor
    return text_of(values, HEADER)


BAD = {
    r"q\d is .* looks like degrees": scaled(BOTH, DEGREE),
    r"q_cmd\d is .* looks like degrees": scaled(COMMANDS, DEGREE),
    r"q_cmd\d is .* expected up to 1000 rad": scaled(BOTH, 4096),
    "q_cmd1": text_of(servo_values()[:, [0, *range(8, 15)]], header_of("q")),
    "missing columns 'q1'": text_of(servo_values()[:, :8], header_of("q_cmd")),
    r"q_cmd1..q_cmd7 and q1..q7 never change": scaled(BOTH, 0.0),
}


@pytest.mark.parametrize("says", BAD)
def test_a_bad_servo_log_is_one_clear_line(tmp_path: Path, says: str) -> None:
    path = put(tmp_path / "log.csv", BAD[says])
    message = refuses(lambda: read(path), says)
    assert message.startswith(str(path))
    assert len(message.replace(str(tmp_path), "")) < 300


def test_units_of_small_motions_show_beside_each_other(tmp_path: Path) -> None:
    """Commands in degrees within the range of radians, without a robot."""
    v = servo_values()
    v[:, COMMANDS] = DEGREE * 0.05 * np.sin(v[:, :1] + np.arange(N))
    v[:, ANGLES] = v[:, COMMANDS] / DEGREE
    path = put(tmp_path / "log.csv", text_of(v, HEADER))
    refuses(lambda: servo_log(path), r"q_cmd moves by 57\.3 times what q does")


def test_check_names_defects_and_calls_nothing_else_wrong(tmp_path: Path) -> None:
    v = servo_values()
    path = put(tmp_path / "good.csv", text_of(v, HEADER))
    assert check(path, robot="panda").findings == ()
    v[:, 9] = 0.25  # joint 2 stands
    v[:, 12] = v[:, 5]  # joint 5 is copied
    v[:, 3] = np.clip(12 * v[:, 3], -3.2, 3.2)  # joint 3 is told beyond its limit, 2.9 rad
    found = check(put(tmp_path / "log.csv", text_of(v, HEADER)), robot="panda").findings
    assert {x.kind for x in found} == {"warning"}
    limits, still, copy = (x.message for x in found)
    assert limits.startswith("q_cmd3 reaches")
    assert "the servo may cut it" in limits
    assert still.startswith("q2 is always 0.25 although its command moves by 0.6 rad")
    assert copy.startswith("q5 equals the command in every row")
    v = servo_values()
    v[:, COMMANDS] = v[0, COMMANDS]
    (finding,) = check(put(tmp_path / "told.csv", text_of(v, HEADER)), robot="panda").findings
    assert finding.message.startswith("q_cmd1..q_cmd7 never change although a joint moves")


def test_torques_without_sign_are_not_called_saturated(tmp_path: Path) -> None:
    v = servo_values()
    size = np.maximum(np.sin(3 * v[:, :1] + np.arange(N)), 0)
    values = np.column_stack([v[:, :1], v[:, 8:], size])
    path = put(tmp_path / "log.csv", text_of(values, header_of("q", "tau")))
    said = [x.message for x in check(path, robot="panda").findings]
    assert any(x.startswith("tau1..tau7 are never negative: sizes without sign") for x in said)
    assert not any("saturated" in x for x in said)


@pytest.mark.parametrize(
    ("robot", "joints", "count", "step"), [("so101", 6, 21, 0.02006), ("go2", 3, 2, 0.005001)]
)
def test_real_servo_logs_are_read_whole(robot: str, joints: int, count: int, step: float) -> None:
    paths = sorted(real("servo_logs").glob(f"{robot}_*.csv.gz"))
    assert len(paths) == count
    for path in paths:
        with gzip.open(path, "rt") as file:
            rows = sum(1 for _ in file) - 1
        assert drive_of(path) == "position"
        log = servo_log(path, joints)
        assert log.q.shape == log.q_cmd.shape == (rows, joints)
        assert log.step == pytest.approx(step, rel=1e-3)
        assert (log.current is not None) == (robot == "so101")
        assert log.warnings == ()
        assert {c.kind for c in log.corrections} <= {"source"}
        assert log.breaks == ()


@pytest.mark.parametrize(("late", "warned"), [(0.05, True), (-0.05, False), (0.0, False)])
def test_commands_after_their_motion_are_found(tmp_path: Path, late: float, warned: bool) -> None:
    """A command that comes later than what it commands has a wrong time."""
    t = np.arange(1000) / 100
    angle = np.outer(t, [0.7, 1.1]) + np.arange(2)
    command = 0.5 * np.sin(angle - late * np.array([0.7, 1.1]))
    np.savez(tmp_path / "log.npz", t=t, q=0.5 * np.sin(angle), q_cmd=command)
    warnings = servo_log(tmp_path / "log.npz", 2).warnings
    assert any("q_cmd comes 50 ms after the motion" in x for x in warnings) == warned
