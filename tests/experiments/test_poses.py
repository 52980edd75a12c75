"""The load and the no-load pose of each joint. Thesis 3.2."""

import mujoco
import numpy as np
import pytest

from stiction_envs.experiments.poses import MARGIN, SWING, PoseLoads, find_poses
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.precomputed import store
from stiction_envs.robots import BUILTIN, load_arm


@pytest.mark.parametrize("robot", BUILTIN)
def test_poses_lie_within_limits_and_swing_without_collision(robot):
    """Every joint inside its limits, the tested one with room for the swing."""
    arm = load_arm(robot)
    q, model = find_poses(arm).q, arm.model()
    low, high = arm.limits.position.T
    assert q.shape == (7, 2, 7)
    assert np.all((q > low) & (q < high))
    data = mujoco.MjData(model)
    for joint, k in np.ndindex(7, 2):
        tested = q[joint, k, joint]
        assert low[joint] + MARGIN - 1e-9 < tested < high[joint] - MARGIN + 1e-9
        for shift in (-SWING, 0.0, SWING):
            data.qpos[:] = q[joint, k]
            data.qpos[joint] += shift
            mujoco.mj_forward(model, data)
            assert data.ncon == 0, f"joint {joint + 1}, {k}, {shift}"


def test_looking_for_poses_leaves_the_model_as_it_was():
    """Contacts are switched on in a copy: the caller's plant has none."""
    arm = load_arm("panda")
    sticking = build(arm, load_friction("generic", arm.n).rigid())
    before = int(sticking.model.opt.disableflags)
    loads = PoseLoads(sticking)
    assert int(sticking.model.opt.disableflags) == before
    folded = np.array([[0.0, 1.7, 0.0, -3.0, 0.0, 3.7, 0.0], arm.rest])
    assert loads(folded)[1].tolist() == [False, True]


@pytest.mark.parametrize("robot", BUILTIN)
def test_load_pose_has_more_load(robot):
    """The load pose comes near the largest load of any pose, the other near none."""
    arm = load_arm(robot)
    poses = find_poses(arm)
    np.testing.assert_array_equal(poses.load, np.abs(poses.signed))
    assert np.all(poses.load[:, 0] > 20 * poses.load[:, 1])
    assert np.all(poses.load[:, 1] < 0.03)
    model = arm.model()
    data = mujoco.MjData(model)
    low, high = arm.limits.position.T
    largest = np.zeros(7)
    for q in np.random.default_rng(0).uniform(low, high, (500, 7)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        largest = np.maximum(largest, np.abs(data.qfrc_bias))
    free = ~poses.bearing
    assert np.all(poses.load[free, 0] > 0.9 * largest[free])


def test_a_search_finds_the_poses_that_are_shipped(monkeypatch):
    shipped = find_poses(load_arm("iiwa7"))
    monkeypatch.setenv("STICTION_CACHE", "off")
    store.forget()
    found = find_poses(load_arm("iiwa7"))
    assert found.q.tobytes() == shipped.q.tobytes()
    assert found.signed.tobytes() == shipped.signed.tobytes()
