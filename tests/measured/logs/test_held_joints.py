"""Logs of arms with slides that their model holds still."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.joint_names import Naming, find_joints, with_held
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm

ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="rail">
<joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="3"/>
<body name="one" pos="0 0 0.2"><joint name="a" axis="0 0 1"/><geom size="0.1" mass="2"/>
<body name="two" pos="0.3 0 0"><joint name="b" axis="0 1 0" range="-2 2"/>
<geom size="0.1" mass="1"/></body></body></body></worldbody></mujoco>"""


def write_log(path: Path, angles: list[np.ndarray]) -> None:
    """Write a log of some joints' angles, with torques that tell the joints apart."""
    n, t = len(angles), np.arange(0, 5, 0.01)
    tau = [0.1 * (j + 1) * np.sin(3 * t) for j in range(n)]
    names = ["t", *(f"{k}{j + 1}" for k in ("q", "tau") for j in range(n))]
    np.savetxt(
        path, np.stack([t, *angles, *tau], 1), delimiter=",", header=",".join(names), comments=""
    )


def read(tmp_path: Path, lift: np.ndarray | None, *, turned: float = 0.0):
    """Return the log of the arm, with a column of its slide unless that is None."""
    robot, path, t = tmp_path / "own.xml", tmp_path / "log.csv", np.arange(0, 5, 0.01)
    robot.write_text(ARM, "utf-8")
    hinges = [turned + np.sin(t), np.cos(2 * t)]
    write_log(path, hinges if lift is None else [lift, *hinges])
    arm = load_arm(robot)
    naming = Naming(robot=arm.joint_names, held=arm.stated.held)
    return read_logs([path], arm.n, limits=arm.limits, naming=naming)[0]


def test_a_slide_that_rests_is_left_out_and_said(tmp_path: Path):
    plain, log = read(tmp_path, None), read(tmp_path, np.full(500, 0.2))
    np.testing.assert_array_equal(log.q, plain.q)
    np.testing.assert_allclose(log.tau, plain.tau * [2.0, 1.5], atol=1e-12)  # of joints 2 and 3
    assert any("'lift' rests" in c.text for c in log.corrections)
    assert not any("rests" in c.text for c in plain.corrections)


def test_a_slide_that_moves_is_refused(tmp_path: Path):
    with pytest.raises(StictionError, match=r"log.csv: joint 'lift' slides by 0\.04 m"):
        read(tmp_path, 0.2 + 0.02 * np.sin(2 * np.pi * np.arange(0, 5, 0.01)))


def test_the_names_of_a_log_with_a_held_joint():
    naming = Naming(robot=("a", "b"), held=((0, "lift"), (2, "reach")))
    assert with_held(naming).robot == ("lift", "a", "reach", "b")


def test_without_a_robot_the_longest_series_of_names_is_the_arm():
    names = ["finger_1", "finger_2", *(f"arm_joint_{j}" for j in range(1, 7))]
    assert find_joints("log", names, None, Naming()) == tuple(names[2:])
    assert find_joints("log", names, 2, Naming()) == ("finger_1", "finger_2")
    assert find_joints("log", ["left", "right"], None, Naming()) == ("left", "right")
