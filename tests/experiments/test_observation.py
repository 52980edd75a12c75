"""Bounds of actions and what is seen of them: limit cases with known answers."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError
from stiction_envs.experiments.observation import action_bounds
from stiction_envs.experiments.poses import find_poses
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm


def test_bounds_are_the_limits_of_torque_stiction_and_controller():
    arm, p = load_arm("panda"), load_friction("panda")
    poses, interface = find_poses(arm), TorqueInterface.of(arm)
    low, high = action_bounds(p, poses, interface)
    assert low.tolist() == [0.0] * 7 + [5.0] * 7
    assert high[7:].tolist() == [100.0] * 7
    at_poses = np.stack([p.stiction_at(poses.load[:, k]) for k in range(2)])
    assert high[:7] == pytest.approx(2.5 * at_poses.max(axis=(0, 2)), rel=1e-12)
    weak = dataclasses.replace(interface, torque_limit=np.full(7, 0.1), controller_rate_hz=50)
    _, high = action_bounds(p, poses, weak)
    assert high.tolist() == [0.1] * 7 + [25.0] * 7
    slow = dataclasses.replace(interface, controller_rate_hz=10)
    with pytest.raises(StictionError, match="controller rate 10 Hz: expected more than 10 Hz"):
        action_bounds(p, poses, slow)
