"""CSV as PlotJuggler exports it."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.log_files import count_joints
from stiction_envs.measured.logs.reader import drive_of
from tests.measured.logs.bad_logs import VALUES, assert_holds, refuses, servo_log, torque_log
from tests.measured.logs.ros_bags import PANDA

FIELDS = ("position", "velocity", "effort")
START = 1_700_000_000.0


def write(path: Path, rows: dict[float, dict[str, float]]) -> Path:
    """Write a row per time, curves in the order of their names, cells empty that did not change."""
    curves = sorted({name for row in rows.values() for name in row})
    lines = [",".join(["__time", *curves])]
    for t in sorted(rows):
        cells = [f"{rows[t][c]:.9g}" if c in rows[t] else "" for c in curves]
        lines.append(",".join([f"{t:.6f}", *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path


def joint_states(topic: str = "/joint_states", names=PANDA) -> dict[float, dict[str, float]]:
    """Return q, dq and tau of `VALUES` as curves."""
    columns = [f"{topic}/{name}/{field}" for field in FIELDS for name in names]
    return {START + row[0]: dict(zip(columns, row[1:], strict=True)) for row in VALUES}


def commands(early: float, prefix: str) -> dict[float, dict[str, float]]:
    """Return every second row's angles as commands some time before."""
    return {
        START + row[0] - early: {f"{prefix}[{j}]": row[1 + j] for j in range(7)}
        for row in VALUES[::2]
    }


def test_joint_states(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", joint_states())
    assert drive_of(path) == "torque"
    assert count_joints(path) == 7
    log = torque_log(path)
    assert_holds(log, VALUES, "q dq tau", atol=1e-7)
    assert log.date == START
    assert log.corrections[0].text.startswith("CSV of PlotJuggler")
    assert not check(path).defects


def test_joints_by_name_whatever_their_order(tmp_path: Path) -> None:
    names = ("wrist", "elbow", "base", "lift", "a", "b", "c")
    path = write(tmp_path / "log.csv", joint_states(names=names))
    for log in (torque_log(path, robot=names), torque_log(path, joints=names)):
        assert_holds(log, VALUES, "q", atol=1e-7)
    refuses(lambda: torque_log(path), "name the joints")
    refuses(lambda: torque_log(path, joints=(*names[:6], "d")), "joint")
    assert count_joints(path) == 7


@pytest.mark.parametrize("side", ["/arm/reference", "/arm/desired"])
def test_commands_of_a_controller_hold_until_the_next(tmp_path: Path, side: str) -> None:
    rows = joint_states() | commands(0.002, f"{side}/positions")
    path = write(tmp_path / "log.csv", rows)
    log = servo_log(path)
    assert len(log.t) == len(VALUES)
    assert_holds(log, VALUES, "q tau", atol=1e-7)
    held = VALUES[np.arange(len(VALUES)) // 2 * 2, 1:8]
    assert log.q_cmd == pytest.approx(held, abs=1e-7)
    # before the first command nothing is known
    late = write(tmp_path / "late.csv", joint_states() | commands(-0.002, f"{side}/positions"))
    assert len(servo_log(late).t) == len(VALUES) - 1


def test_several_topics(tmp_path: Path) -> None:
    rows = joint_states()
    for row, other in zip(rows.values(), joint_states("/other").values(), strict=True):
        row |= other
    path = write(tmp_path / "log.csv", rows)
    refuses(lambda: torque_log(path), "/joint_states, /other: expected one; name the topic")
    assert_holds(torque_log(path, topic="/other"), VALUES, "q", atol=1e-7)
    refuses(lambda: torque_log(path, topic="/else"), "/else")
