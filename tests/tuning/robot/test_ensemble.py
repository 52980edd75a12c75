"""Frictions of an arm that nobody has fitted, and what readings say about them."""

from __future__ import annotations

import dataclasses

import numpy as np

from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm
from tests.tuning.robot.made_up import (
    NOTHING,
    S,
    joint,
    posterior_of,
    read,
)
from tuning.robot.ensemble import plausible

FLAT = np.full(4, 0.8)
LOW_FIRST, LOW_LAST = np.array([0.5, 0.7, 0.9, 1.1]), np.array([1.1, 0.9, 0.7, 0.5])


def unsure(*each: np.ndarray):
    """Return settings whose predictions under several frictions are these, alike in all cells."""
    cells = np.repeat(np.array(each)[:, :, None], 4, axis=2)
    c = joint(cells.mean(axis=0)[:, 0])
    return dataclasses.replace(c, deviation=cells - cells.mean(axis=0))


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


def test_joints_that_were_fitted_stay_as_they_are():
    nominal = load_friction("generic", 7)
    rotor = nominal.rotor_inertia.copy()
    rotor[2] = 0.2
    other = plausible(nominal.replace(rotor_inertia=rotor), S)[1]
    assert other.rotor_inertia[2] == 0.2
    assert other.bristle_stiffness[2] == nominal.bristle_stiffness[2]
    assert np.flatnonzero(~other.elastic).tolist() == [2]


def test_what_frictions_disagree_about_is_unsure():
    """The sample covariance of the members is added: of two, half the squared difference."""
    c = unsure(LOW_FIRST, LOW_LAST)
    added = posterior_of(c, NOTHING).sd ** 2 - posterior_of(joint(FLAT), NOTHING).sd ** 2
    np.testing.assert_allclose(added, (LOW_FIRST - LOW_LAST) ** 2 / 2)


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
