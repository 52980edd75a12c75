"""Defects in logs of real robots, and in simulated copies with the same defects.

The real ones are there on some machines only.
"""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses
from stiction_envs.robots import load_arm
from tests.measured.logs.robot_logs import excitation, real, sweeps
from tests.measured.logs.test_corrections import corrected

PANDA, IIWA = (load_arm(name).limits for name in ("panda", "iiwa14"))


def number(text: str, before: str, after: str) -> float:
    return float(text.split(before)[1].split(after)[0])


def assert_log_of_a_pc(log: JointLog, repeats: int, stale: list[int], lag_ms: object) -> None:
    """Repeats, old angles, halves of a sample, a jittering clock with lost samples, late speeds."""
    assert corrected(log)["repeat"] == repeats
    old = [c.rows for c in log.corrections if "old q" in c.text or "half" in c.text]
    assert sorted(old) == sorted(stale)
    step = np.diff(log.t) / 1e-3
    assert np.abs(step - np.round(step)).max() < 1e-6
    assert np.round(step).max() > 1  # lost samples stay lost
    assert log.breaks == ()
    assert "robot clock rebuilt: the angles follow a regular 1 ms clock" in log.corrections[-1].text
    lag, angles = log.warnings
    assert number(lag, " by ", " ms") == lag_ms
    assert "q may be the commanded position" in angles


def test_a_log_by_a_pc_gives_the_robots_samples_back(tmp_path: Path) -> None:
    shaken = excitation(tmp_path / "log.csv")
    (log,) = read_logs([shaken.path], 7, limits=PANDA)
    # a low-pass of 5 ms
    stale = [shaken.halves, shaken.old_q]
    assert_log_of_a_pc(log, shaken.repeats, stale, pytest.approx(5, abs=0.6))


def test_panda_defects_are_found() -> None:
    """The reader finds the defects that the log's README lists."""
    path = real("panda_exciting_trajectory/panda_exciting_trajectory.csv.gz")
    (log,) = read_logs([path], 7, limits=PANDA)
    assert_log_of_a_pc(log, 1131, [59, 63], pytest.approx(5.3, abs=0.5))


def assert_runs_of_a_joint(log: JointLog) -> str:
    """Runs of one file stay apart; returns the warning about speeds."""
    assert corrected(log) == {"run": 7}
    assert len(log.segments) == 8
    assert log.step == pytest.approx(5e-3)
    unused, lag = log.warnings
    assert unused == "columns not used: 'segment'"
    assert "lags the derivative of q" in lag
    return lag


def test_runs_of_one_file_stay_apart(tmp_path: Path) -> None:
    (log,) = read_logs([sweeps(tmp_path / "joint2.csv", 2)], 7, limits=IIWA)
    lag = assert_runs_of_a_joint(log)
    # a low-pass of 20 ms
    assert number(lag, " by ", " ms") == pytest.approx(20, rel=0.2)


def test_iiwa_defects_are_found() -> None:
    path = real("iiwa14_joint_friction/joint2.csv.gz")
    assert_runs_of_a_joint(read_logs([path], 7, limits=IIWA)[0])


def test_iiwa_poses() -> None:
    path = real("iiwa14_joint_friction/static_poses.csv.gz")
    log = read_poses(path, 7, limits=IIWA)
    assert log.static
    assert log.q.shape == (996, 7)
    assert (log.q[1, 1], log.tau[1, 1]) == (-0.69958, -46.527)
    assert log.warnings == ("columns not used: 'session'",)


def test_staubli_is_clean() -> None:
    (log,) = read_logs([real("staubli_tx40/tx40.csv.gz")], 6)
    assert (log.corrections, log.warnings, log.breaks, log.dq) == ((), (), (), None)
