"""Where arms under position servos come to rest, against closed forms."""

import numpy as np
import pytest

from stiction_envs.control.position_servo import put_under_servos
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments import reach as module
from stiction_envs.experiments.reach import Moves, random_poses, reach, weights
from stiction_envs.friction.servos import read_servos
from stiction_envs.friction.sticking import sticking_model
from tests.servo_arm import STICTION, servo_arm

GOAL = np.array([0.3, 0.2])


def arm_of(folder, **changes):
    arm, path = servo_arm(folder, **changes)
    servos, sticking = read_servos(path, arm.n), sticking_model(arm, path)
    put_under_servos(sticking, servos)
    return sticking, servos


def moves(start, *, amplitude=0.0, frequency=5.0, fades=False, past=0.0):
    start = np.atleast_2d(start)
    goal = np.broadcast_to(GOAL, start.shape)
    return Moves(
        start=start,
        goal=goal,
        past=past + np.zeros_like(start),
        amplitude=amplitude + np.zeros_like(start),
        frequency=np.full(len(start), frequency),
        phase=np.zeros_like(start),
        fades=np.full(len(start), fades),
    )


BOTH_SIDES = GOAL + np.array([[0.3, 0.3], [-0.3, -0.3]])


def test_without_friction_the_error_is_the_sag_of_gravity(tmp_path):
    sticking, servos = arm_of(tmp_path, stiction=0.0)
    found = reach(sticking, servos, moves(BOTH_SIDES), threads=1)
    balance, _ = weights(sticking, servos, GOAL + found.sag)
    np.testing.assert_allclose(found.sag, -balance / servos.stiffness, atol=1e-6)
    np.testing.assert_allclose(found.error, found.sag, atol=1e-5)
    np.testing.assert_allclose(found.shaking, 0.0, atol=1e-6)


def test_friction_leaves_the_arm_on_the_side_it_came_from(tmp_path):
    sticking, servos = arm_of(tmp_path)
    found = reach(sticking, servos, moves(BOTH_SIDES), threads=1)
    half = (found.error[0] - found.error[1]) / 2
    np.testing.assert_allclose(half, np.array(STICTION) / servos.stiffness, rtol=0.15)
    middle = found.error.mean(axis=0)
    np.testing.assert_allclose(middle, found.sag[0], atol=5e-4)
    np.testing.assert_allclose(found.friction_error, [half, -half], atol=5e-4)


def test_dither_that_fades_takes_friction_away_and_leaves_the_arm_still(tmp_path):
    sticking, servos = arm_of(tmp_path)
    size = np.array(STICTION) / servos.stiffness
    without = reach(sticking, servos, moves(BOTH_SIDES), threads=1)
    on, faded = (
        reach(sticking, servos, moves(BOTH_SIDES, amplitude=size, fades=x), threads=1)
        for x in (False, True)
    )
    for found in (on, faded):
        assert (abs(found.friction_error) < 0.2 * abs(without.friction_error)).all()
    assert (on.shaking > 1e-4).all()
    assert (on.tip_speed > 1e-3).all()
    assert faded.shaking.max() < 1e-6
    assert faded.tip_speed.max() < 1e-5


def test_a_command_past_the_goal_by_friction_and_gravity_reaches_it(tmp_path):
    sticking, servos = arm_of(tmp_path)
    balance, stiction = weights(sticking, servos, np.broadcast_to(GOAL, (2, 2)))
    past = (np.sign(GOAL - BOTH_SIDES) * stiction + balance) / servos.stiffness
    plain, found = (
        reach(sticking, servos, moves(BOTH_SIDES, past=x), threads=1) for x in (0.0, past)
    )
    assert (abs(found.error) < 0.15 * abs(plain.error).max(axis=0)).all()


def test_held_commands_are_computed_at_their_rate(tmp_path):
    sticking, servos = arm_of(tmp_path)
    # 50 Hz sampled at 50 Hz is a constant
    still, shaken = (
        reach(sticking, servos, moves(BOTH_SIDES, amplitude=0.05, frequency=50.0), hold_steps=h)
        for h in (20, 1)
    )
    assert still.shaking.max() < 1e-6
    assert shaken.shaking.max() > 1e-5


def test_a_servo_that_cannot_hold_the_goal_is_an_error(tmp_path):
    sticking, servos = arm_of(tmp_path, torque_limit=0.7)
    with pytest.raises(ExperimentError, match="joint 1 cannot be held"):
        reach(sticking, servos, moves(BOTH_SIDES), threads=1)


def test_too_few_free_poses_are_an_error(tmp_path, monkeypatch):
    sticking, _ = arm_of(tmp_path)
    monkeypatch.setattr(module, "_DRAWS", 2)
    with pytest.raises(StictionError, match=r"512 of 512 random poses .* expected 1000"):
        random_poses(sticking.arm, 1000, 0)
