"""Which point and frame are controlled and measured, and where the arm starts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stiction_envs.control import rotation
from stiction_envs.control.trajectory import Path
from stiction_envs.experiments.gte.protocol import Case, pose_error
from stiction_envs.robots import load_arm
from tests.experiments.gte.short_paths import STIFF, bench, one
from tests.robots.arms import flange


def test_orientation_is_read_in_the_hands_frame():
    """The Panda's hand starts with yaw 0, its flange with −45°; turns about x, y are roll, pitch.

    The iiwas have no hand: the flange's frame.
    """
    arm = load_arm("panda")
    rpy = rotation.to_rpy(bench(scatter=False).rig(1, 1).start_quaternion)
    np.testing.assert_allclose([abs(rpy[0]), *rpy[1:]], [np.pi, 0.0, 0.0], atol=1e-9)
    turn = Rotation.from_matrix(flange(arm, arm.rest)[:3, :3])
    assert turn.as_euler("xyz")[2] == pytest.approx(-np.pi / 4)
    for robot in ("iiwa7", "iiwa14"):
        assert load_arm(robot).hand_yaw == 0.0
    # a joint that turns the hand about the base's x shows as roll alone
    half = 0.02
    path = Path("turn", np.zeros((1, 3)), np.array([[np.cos(half), np.sin(half), 0.0, 0.0]]))
    b = bench(kind="none", tail=8.0, scatter=False, paths={"turn": path})
    run = one(b, Case(trajectory="turn", stiffness=STIFF))
    begin = np.append(np.zeros(3), rotation.to_rpy(b.rig(1, 1).start_quaternion))
    moved = pose_error(run.actual[0, -1], begin)[3:]
    np.testing.assert_allclose(moved, [2 * half, 0.0, 0.0], atol=1e-3)


def test_a_push_at_the_flange_turns_an_arm_controlled_at_its_tool():
    """e = K⁻¹ F at the tool point: a weight that is off it by a lever tilts the hand by K_r⁻¹ M.

    The weight is on the hand's x axis and unknown to the controller.
    """
    mass, lever = 0.4, 0.06
    yaw = load_arm("panda").hand_yaw
    x, y = lever * np.cos(yaw), lever * np.sin(yaw)  # the hand's x in the flange's frame
    loaded = load_arm("panda", payload=(mass, x, y, 0.0))
    errors, model = [], load_arm("panda")
    for tool in ((0.0, 0.0, 0.0), (lever, 0.0, 0.0)):
        b = bench(loaded, "none", tail=8.0, scatter=False, tool=tool, controller_model=model)
        run = one(b, Case(trajectory="stay", stiffness=STIFF))
        poses = (rotation.from_rpy(p[0, -1, 3:])[None] for p in (run.actual, run.reference))
        errors.append([run.error[0, -1, 2], rotation.rotation_error(*poses)[0, 1]])
    sag, tilt = -mass * 9.81 / STIFF[0], lever * mass * 9.81 / STIFF[1]
    np.testing.assert_allclose(errors, [[sag, tilt], [sag, 0.0]], atol=5e-4)
