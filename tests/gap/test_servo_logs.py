from pathlib import Path

import numpy as np
import pytest

from stiction_envs import diagnose
from stiction_envs.hidden.examples import log_csv
from stiction_envs.robots import Arm
from tests.gap.servo.small_arm import two_links
from tests.refusal import refusal


@pytest.fixture
def robot(tmp_path: Path) -> Arm:
    return two_links(tmp_path)


def _log(path: Path, *, torque: bool = False, joints: int = 2) -> Path:
    t = np.arange(0.0, 5.0, 0.02)
    q = 0.3 * np.sin(np.outer(t, np.arange(1, joints + 1)))
    path.write_text(log_csv(t, **{"tau" if torque else "q_cmd": q, "q": q + 0.01}))
    return path


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"torque": "link"}, "torque: expected joint logs"),
        ({"cutoff_hz": 5.0}, "cutoff: expected joint logs"),
        ({"servo_stiffness": [1.0, 2.0, 3.0]}, r"has shape \(3,\): .* of shape \(2,\)"),
        ({"servo_stiffness": [-1.0]}, r"is -1: .* from \S+ N·m/rad"),
        ({"servo_damping": [1.0]}, "servo damping: expected with a servo stiffness"),
        ({"nominal": "shipped"}, r"servo logs expect rigid, file, or the model\.toml"),
        ({"drive": "magic"}, "unknown drive"),
    ],
)
def test_bad_options_of_a_servo_log_are_one_line(
    tmp_path: Path, robot: Arm, options: dict[str, object], said: str
) -> None:
    log = _log(tmp_path / "log.csv")
    refusal(lambda: diagnose(log, robot, **options), said)  # type: ignore[arg-type]


def test_logs_that_do_not_fit_are_refused(tmp_path: Path, robot: Arm) -> None:
    log, torques = _log(tmp_path / "log.csv"), _log(tmp_path / "torques.csv", torque=True)
    three = _log(tmp_path / "three.csv", joints=3)
    says = "servo stiffness: expected servo logs"
    refusal(lambda: diagnose(torques, robot, servo_stiffness=[10.0]), says)
    says = r"check log .*log\.csv: it is diagnosed too"
    refusal(lambda: diagnose(log, robot, check=[log]), says)
    refusal(lambda: diagnose([log, torques], robot), "expected one kind")
    refusal(lambda: diagnose(three, robot), "3 joints, but the robot has 2")


def test_commands_that_are_differences_are_refused(tmp_path: Path, robot: Arm) -> None:
    t = np.arange(0.0, 5.0, 0.02)
    q = 0.3 * np.sin(np.outer(t, [1.0, 2.0]))
    path = tmp_path / "log.csv"
    path.write_text(log_csv(t, q_cmd=np.diff(q, axis=0, prepend=q[:1]), q=q))
    says = "q_cmd are differences of angles from row to row"
    refusal(lambda: diagnose(path, robot, drive="position"), says)


def test_a_command_that_comes_after_the_motion_is_said(tmp_path: Path, robot: Arm) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    path = tmp_path / "log.csv"
    late = 0.3 * np.sin(np.outer(t - 0.046, [1.0, 2.0]))
    path.write_text(log_csv(t, q_cmd=late, q=0.3 * np.sin(np.outer(t, [1.0, 2.0]))))
    notes = diagnose(path, robot).diagnosis.notes  # type: ignore[attr-defined]
    assert "log.csv: the command comes 46 to 46 ms after the motion of 2 joints" in " ".join(notes)
