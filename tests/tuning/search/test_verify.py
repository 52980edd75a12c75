"""What was found is measured from a start that the search has not seen."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tuning.search.verify import another_start


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
def test_another_start_is_another_pose_off_the_limits(robot):
    arm, most = load_arm(robot), 0.1
    low, high = arm.limits.position.T
    starts = np.array([another_start(arm, most, seed) for seed in range(20)])
    assert np.all(starts >= low + most)
    assert np.all(starts <= high - most)
    moved = np.abs(starts - np.clip(arm.rest, low + most, high - most))
    assert np.all(moved <= most)
    assert moved.mean() > 0.3 * most, "of even draws half"
    assert np.array_equal(another_start(arm, most, [3, 4]), another_start(arm, most, [3, 4]))
