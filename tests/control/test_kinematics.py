"""Pose and Jacobian of the end effector against MuJoCo's own, simulation by simulation."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stiction_envs.control.kinematics import EndEffector, MeasuredEndEffector
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.plant import Plant
from stiction_envs.robots import load_arm
from tests.robots.arms import write_arms


@pytest.mark.parametrize(
    ("robot", "tool"), [("panda", (0, 0, 0)), ("panda", (0.03, -0.07, 0.11)), ("iiwa7", (0, 0, 0))]
)
def test_pose_and_jacobian_are_mujocos(robot, tool):
    """Law checked: v = J q̇ at the tool; the hand is the flange turned about its z."""
    model = sticking_model(robot)
    plant = Plant(model, 3, threads=1, closed_loop=True)
    hand = EndEffector(model, plant.batch, tool)
    q = model.arm.rest + np.random.default_rng(0).uniform(-0.5, 0.5, (3, model.n))
    plant.reset(np.arange(3), q)
    hand.read()
    site = model.model.site(model.arm.end_effector).id
    yaw = Rotation.from_euler("z", model.arm.hand_yaw)
    for i in range(3):
        data = mujoco.MjData(model.model)
        data.qpos[model.motor] = q[i]
        mujoco.mj_forward(model.model, data)
        turned = Rotation.from_matrix(data.site_xmat[site].reshape(3, 3)) * yaw
        tip, jacobian = data.site_xpos[site] + turned.apply(tool), np.zeros((6, model.model.nv))
        body = model.model.site_bodyid[site]
        mujoco.mj_jac(model.model, data, jacobian[:3], jacobian[3:], tip, body)
        np.testing.assert_allclose(hand.position[i], tip, atol=1e-12)
        np.testing.assert_allclose(hand.jacobian[i], jacobian[:, model.motor], atol=1e-12)
        found = Rotation.from_quat(hand.quaternion[i], scalar_first=True)
        assert (found * turned.inv()).magnitude() < 1e-9


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "tilted", "three.xml", "two.urdf"])
def test_measured_angles_have_the_engines_pose(robot, tmp_path):
    """Own kinematics of the angles are the engine's, elastic joints and fixed bodies included."""
    if robot == "tilted":
        arm = load_arm("panda", tilt=(0.1, -0.2), payload=(1.0, 0.0, 0.1, 0.2))
    else:
        arm = load_arm(write_arms(tmp_path) / robot if "." in robot else robot)
    model = sticking_model(arm)
    plant = Plant(model, 3, threads=1, closed_loop=True)
    tool = (0.01, -0.02, 0.1)
    true = EndEffector(model, plant.batch, tool)
    low, high = np.clip(arm.limits.position, -3.0, 3.0).T
    q = low + (high - low) * np.random.default_rng(0).random((3, model.n))
    plant.reset(np.arange(3), q)
    true.read()
    seen = MeasuredEndEffector(arm, plant.position, tool)
    seen.read()
    for name in ("position", "quaternion", "jacobian"):
        np.testing.assert_allclose(getattr(seen, name), getattr(true, name), atol=1e-12)
