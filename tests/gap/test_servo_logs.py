from pathlib import Path

import numpy as np
import pytest

from stiction_envs import diagnose
from stiction_envs.errors import StictionError
from stiction_envs.hidden.examples import log_csv
from tests.gap.servo.small_arm import TWO_LINKS


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "two_links.xml"
    path.write_text(TWO_LINKS)
    return path


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
        ({"servo_stiffness": [1.0, 2.0, 3.0]}, "expected 1 number, or 2"),
        ({"servo_stiffness": [-1.0]}, "expected more than 0 N·m/rad"),
        ({"servo_damping": [1.0]}, "servo damping: expected with a servo stiffness"),
        ({"nominal": "shipped"}, "servo logs expect rigid, file, or the model.toml"),
        ({"drive": "magic"}, "unknown drive"),
    ],
)
def test_bad_options_of_a_servo_log_are_one_line(
    tmp_path: Path, robot: Path, options: dict[str, object], said: str
) -> None:
    with pytest.raises(StictionError) as error:
        diagnose(_log(tmp_path / "log.csv"), robot, **options)  # type: ignore[arg-type]
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_logs_that_do_not_fit_are_refused(tmp_path: Path, robot: Path) -> None:
    log, torques = _log(tmp_path / "log.csv"), _log(tmp_path / "torques.csv", torque=True)
    with pytest.raises(StictionError, match="servo stiffness: expected servo logs"):
        diagnose(torques, robot, servo_stiffness=[10.0])
    with pytest.raises(StictionError, match=r"check log .*log\.csv: it is diagnosed too"):
        diagnose(log, robot, check=[log])
    with pytest.raises(StictionError, match="expected one kind"):
        diagnose([log, torques], robot)
    with pytest.raises(StictionError, match="3 joints, but the robot has 2"):
        diagnose(_log(tmp_path / "three.csv", joints=3), robot)


def test_commands_that_are_differences_are_refused(tmp_path: Path, robot: Path) -> None:
    t = np.arange(0.0, 5.0, 0.02)
    q = 0.3 * np.sin(np.outer(t, [1.0, 2.0]))
    path = tmp_path / "log.csv"
    path.write_text(log_csv(t, q_cmd=np.diff(q, axis=0, prepend=q[:1]), q=q))
    with pytest.raises(StictionError, match="q_cmd are differences of angles from row to row"):
        diagnose(path, robot, drive="position")


def test_a_command_that_comes_after_the_motion_is_said(tmp_path: Path, robot: Path) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    path = tmp_path / "log.csv"
    late = 0.3 * np.sin(np.outer(t - 0.046, [1.0, 2.0]))
    path.write_text(log_csv(t, q_cmd=late, q=0.3 * np.sin(np.outer(t, [1.0, 2.0]))))
    notes = diagnose(path, robot).diagnosis.notes  # type: ignore[attr-defined]
    assert "log.csv: the command comes 46 to 46 ms after the motion of 2 joints" in " ".join(notes)
