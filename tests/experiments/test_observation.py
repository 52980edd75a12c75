"""Bounds of actions and what is seen of them: limit cases with known answers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError
from stiction_envs.experiments.observation import Group, action_bounds, observed_action, pack
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


def test_actions_are_seen_between_minus_one_and_one():
    low, high = np.array([0.0, 5.0]), np.array([2.0, 105.0])
    amplitude, frequency = observed_action(np.array([low, high, [0.5, 55.0]]), low, high)
    assert amplitude.tolist() == [[-1], [1], [-0.5]]
    assert frequency.tolist() == [[-1], [1], [0]]


def test_observations_are_in_the_order_of_the_groups_and_within_their_bounds():
    names = ("b", "a")
    groups = [Group(name=k, low=-1.0, high=1.0, unit="1", meaning="") for k in names]
    low, high = np.full((2, 3), 1.0, dtype=np.float32) * [[-1], [1]]
    values = {"a": np.array([0.1, 7.0]), "b": np.array([[0.2, -7.0], [0.3, 0.4]])}
    out = pack(groups, values, 2, low, high)
    assert out.dtype == np.float32
    assert out == pytest.approx(np.array([[0.2, -1.0, 0.1], [0.3, 0.4, 1.0]]))
