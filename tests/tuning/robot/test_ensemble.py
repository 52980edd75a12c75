"""Frictions under which settings are tried, and what readings say about them."""

import dataclasses

import numpy as np

from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm
from tests.tuning.robot.made_up import S, joint, posterior_of, read
from tuning.search.frictions import DRAWN, frictions, plausible

LOW_FIRST, LOW_LAST = np.array([0.5, 0.7, 0.9, 1.1]), np.array([1.1, 0.9, 0.7, 0.5])


def unsure(*each: np.ndarray):
    """Return settings whose predictions under several frictions are these, alike in all cells."""
    cells = np.repeat(np.array(each)[:, :, None], 4, axis=2)
    c = joint(cells.mean(axis=0)[:, 0])
    return dataclasses.replace(c, deviation=cells - cells.mean(axis=0))


def test_the_first_is_the_models_own_and_the_others_spread_about_it():
    nominal = load_friction("panda")
    drawn = frictions(nominal, 400, spread=0.1, seed=3)
    assert drawn[0] is nominal
    for name in DRAWN:
        ratio = np.array([getattr(p, name) for p in drawn[1:]]) / getattr(nominal, name)
        spread = np.log(ratio).std(axis=0)
        assert np.all(np.abs(spread - 0.1) < 0.02)
        assert np.all(np.abs(np.log(ratio).mean(axis=0)) < 0.02)
    up, down = (np.array([p.stiction[:, k] for p in drawn[1:]]) for k in (0, 1))
    assert np.allclose(up / down, nominal.stiction[:, 0] / nominal.stiction[:, 1])


def test_an_arm_that_was_fitted_has_one_friction():
    nominal = load_friction("panda")
    assert plausible(nominal, S) == [nominal]


def test_unfitted_joints_get_springs_and_the_arm_can_be_simulated():
    arm, nominal = load_arm("panda"), load_friction("generic", 7)
    first, *others = found = plausible(nominal, S)
    assert first is nominal
    assert len(found) == S.members
    for p in others:
        assert p.elastic.all()
        assert np.array_equal(p.stiction, nominal.stiction), "base torques say how strong it is"
        build(arm, p)
    assert len({tuple(p.bristle_stiffness) for p in found}) == S.members
    again = plausible(nominal, S)
    assert np.array_equal(again[-1].joint_stiffness, others[-1].joint_stiffness)


def test_a_reading_that_fits_one_friction_moves_all_settings_towards_it():
    c = unsure(LOW_FIRST, LOW_LAST)
    truth = np.repeat(LOW_FIRST[:, None], 4, axis=1)
    known = posterior_of(c, read(truth, [3])).mean
    alone = posterior_of(
        dataclasses.replace(c, deviation=np.zeros((1, 4, 4))), read(truth, [3])
    ).mean
    assert np.argmin(known) == 0
    assert abs(known[0] - 0.5) < 0.05
    assert alone[0] > 0.75, "without the ensemble the lowest frequency is not suspected"
