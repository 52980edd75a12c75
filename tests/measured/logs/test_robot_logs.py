"""What the reader finds in logs with a real robot's defects, all at once: simulated copies.

The real ones (`test_corrections.py`) are there on some machines only.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.logs.reader import JointLog, read_logs, read_poses
from stiction_envs.robots import load_arm
from tests.measured.logs.robot_logs import excitation, static_poses, sweeps


def corrected(log: JointLog) -> Counter[str]:
    found: Counter[str] = Counter()
    for correction in log.corrections:
        found[correction.kind] += correction.rows
    return found


def test_a_log_by_a_pc_gives_the_robots_samples_back(tmp_path: Path) -> None:
    """Repeats, old angles, halves of a sample, a jittering clock with lost samples, late speeds."""
    shaken = excitation(tmp_path / "log.csv")
    (log,) = read_logs([shaken.path], 7, limits=load_arm("panda").limits)
    found = corrected(log)
    assert found["repeat"] == shaken.repeats
    stale = [c.rows for c in log.corrections if c.kind == "stale"]
    assert sorted(stale) == [shaken.halves, shaken.old_q]
    step = np.diff(log.t) / 1e-3
    assert np.abs(step - np.round(step)).max() < 1e-6
    assert np.round(step).max() > 1  # lost samples stay lost
    assert log.breaks == ()
    lag, obedient = log.warnings
    # a low-pass of 5 ms
    assert float(lag.split(" by ")[1].split(" ms")[0]) == pytest.approx(5, abs=0.6)
    assert "commanded position" in obedient


def test_the_same_log_without_defects_is_left_alone(tmp_path: Path) -> None:
    shaken = excitation(tmp_path / "log.csv", defects=False)
    (log,) = read_logs([shaken.path], 7, limits=load_arm("panda").limits)
    assert (log.corrections, log.warnings, log.breaks) == ((), (), ())
    assert len(log.t) == 20_000


def test_runs_of_one_file_stay_apart(tmp_path: Path) -> None:
    path = sweeps(tmp_path / "joint2.csv", 2)
    (log,) = read_logs([path], 7, limits=load_arm("iiwa14").limits)
    assert corrected(log) == {"run": 7}
    assert len(log.segments) == 8
    assert log.step == pytest.approx(5e-3)
    unused, lag = log.warnings
    assert "'segment'" in unused
    # a low-pass of 20 ms, 8 Hz
    assert float(lag.split(" by ")[1].split(" ms")[0]) == pytest.approx(20, rel=0.2)
    assert float(lag.split("near ")[1].split(" Hz")[0]) == pytest.approx(8, rel=0.2)


def test_poses_of_several_sessions(tmp_path: Path) -> None:
    log = read_poses(static_poses(tmp_path / "poses.csv"), 7, limits=load_arm("iiwa14").limits)
    assert log.static
    assert log.q.shape == log.tau.shape == (60, 7)
    (unused,) = log.warnings
    assert "'session'" in unused
