"""Logs of arms with slides that their model holds still."""

from pathlib import Path

import numpy as np

from stiction_envs.hidden.examples import log_csv
from stiction_envs.measured.logs.joint_names import Naming, find_joints, with_held
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import put, refuses, torque_log
from tests.robots.arms import RAIL

T = np.arange(0, 5, 0.01)


def read(tmp_path: Path, *lift: np.ndarray):
    """Return the log of the arm, with a column of its slide if given; torques tell joints apart."""
    angles = [*lift, np.sin(T), np.cos(2 * T)]
    tau = 0.1 * np.outer(np.sin(3 * T), 1 + np.arange(len(angles)))
    path = put(tmp_path / "log.csv", log_csv(T, digits=15, q=np.stack(angles, 1), tau=tau))
    arm = load_arm(put(tmp_path / "own.xml", RAIL))
    names = {"robot": arm.joint_names, "held": arm.stated.held}
    return torque_log(path, arm.n, limits=arm.limits, **names)


def test_a_slide_that_rests_is_left_out_and_said(tmp_path: Path):
    plain, log = read(tmp_path), read(tmp_path, np.full(500, 0.2))
    np.testing.assert_array_equal(log.q, plain.q)
    np.testing.assert_allclose(log.tau, plain.tau * [2.0, 1.5], atol=1e-12)  # of joints 2 and 3
    assert any("'lift' rests" in c.text for c in log.corrections)
    assert not any("rests" in c.text for c in plain.corrections)


def test_a_slide_that_moves_is_refused(tmp_path: Path):
    lift = 0.2 + 0.02 * np.sin(2 * np.pi * T)
    refuses(lambda: read(tmp_path, lift), r"log.csv: joint 'lift' slides by 0\.04 m")


def test_the_names_of_a_log_with_a_held_joint():
    naming = Naming(robot=("a", "b"), held=((0, "lift"), (2, "reach")))
    assert with_held(naming).robot == ("lift", "a", "reach", "b")


def test_without_a_robot_the_longest_series_of_names_is_the_arm():
    names = ["finger_1", "finger_2", *(f"arm_joint_{j}" for j in range(1, 7))]
    assert find_joints("log", names, None, Naming()) == tuple(names[2:])
    assert find_joints("log", names, 2, Naming()) == ("finger_1", "finger_2")
    assert find_joints("log", ["left", "right"], None, Naming()) == ("left", "right")
