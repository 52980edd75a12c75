"""Identification: true parameters inside their errors, physically consistent links."""

import dataclasses

import mujoco
import numpy as np
import pytest

from benchmarks.accuracy import imperfect_arms as excited
from stiction_envs.identification.excitation import excite
from stiction_envs.identification.identify import MODELS, identify
from stiction_envs.robots import load_arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import columns_of, consistent, inertial_parameters
from tests.identification.test_excitation import panda as panda
from tests.refusal import refusal
from tests.robots.arms import write_arms

RATE = 200.0


@pytest.fixture(scope="module")
def motion(panda):
    return excite(panda, {"iterations": 30, "starts": 1, "randoms": 6}, seed=1)


@pytest.fixture(scope="module")
def true(panda):
    return excited.perturbed(panda, 0.2, 0)


@pytest.fixture(scope="module")
def recorded(motion, true):
    state = motion.state(motion.times(RATE))
    return excited.log(true, state, RATE, noise=0.1, seed=1)


@pytest.fixture(scope="module")
def found(panda, recorded):
    return identify([recorded], panda, torque="link")


def test_true_base_parameters_lie_within_their_intervals(motion, panda, true):
    """Over four recordings 95 % intervals hold 256 true values as often as they say."""
    state = motion.state(motion.times(RATE))
    inside = []
    for seed in range(4):
        log = excited.log(true, state, RATE, noise=0.1, seed=seed)
        found = identify([log], panda, torque="link")
        error = found.values - found.base.values(excited.truth(true))
        inside += (np.abs(error) < 1.96 * found.errors).tolist()
    assert 0.89 <= np.mean(inside) <= 0.99


def test_held_out_residual_falls_to_the_noise(found):
    assert set(found.rms) == set(MODELS)
    ratio = found.rms["consistent"] / found.rms["nominal + friction"]
    assert (ratio < 0.9).all()
    assert ratio.mean() < 0.5
    assert (found.rms["consistent"] < 0.08).all()  # noise was 0.1 N·m before the filter
    assert found.gain_percent > 50


def test_links_can_exist_and_friction_is_found(found):
    assert consistent(found.phi).all()
    assert (found.phi[:, 0] > 0).all()
    np.testing.assert_allclose(found.coulomb, excited.COULOMB, atol=0.1)
    np.testing.assert_allclose(found.offset, excited.OFFSET, atol=0.1)
    assert found.rotor is None
    assert found.condition < 40


def test_consistent_links_lie_nearer_to_the_truth_than_the_nominal(found, true):
    own = np.concatenate([found.phi.ravel(), found.coulomb, found.viscous, found.offset])
    right = found.base.values(excited.truth(true))
    ours = (found.base.values(own) - right) / found.errors
    nominal = (found.nominal_values - right) / found.errors
    free = (found.values - right) / found.errors
    assert np.linalg.norm(ours[:43]) < 0.1 * np.linalg.norm(nominal[:43])
    assert np.linalg.norm(ours) < 1.2 * np.linalg.norm(free)


def test_says_what_is_hardly_excited(panda):
    """Joints 1 and 2 at rest: their friction and link 2 are not in the torques."""
    reach = np.array([0, 0, 0.5, 0.5, 0.5, 0.5, 0.5])
    state = excited.from_pose_to_pose(panda, reach, 30.0, RATE, 0)
    found = identify([excited.log(panda, state, RATE, noise=0.1, seed=0)], panda, torque="link")
    unsure = {found.names[i] for i in found.unsure}
    assert {"Fc1", "Fc2", "Fv1", "Fv2"} <= unsure
    assert not unsure & set(found.on_bound)
    assert not {"Fc3", "Fc7", "Fv7"} & unsure
    assert consistent(found.phi).all()
    nominal = inertial_parameters(panda.pinocchio())[:, 0]
    assert np.abs(found.phi[:, 0] / nominal - 1).max() < 0.3  # the nominal stands in
    assert found.viscous.max() < 5


@pytest.mark.slow
def test_a_fit_that_may_be_free_is_the_free_one(panda, motion, true):
    """Without noise and far from every bound, links that exist give the same base parameters."""
    state = motion.state(motion.times(RATE))
    clean = excited.log(true, state, RATE, noise=1e-3, seed=0, angle_noise=1e-8)
    found = identify([clean], panda, torque="link", cutoff_hz=15.0)
    q, dq, ddq = (x[::10] for x in state)
    own = np.stack([np.sign(dq), dq, np.ones_like(dq)], axis=2)
    columns = columns_of(panda.pinocchio(), q, dq, ddq, own)
    p = np.concatenate([found.phi.ravel(), found.coulomb, found.viscous, found.offset])
    ours, theirs = columns @ p, columns[:, :, found.base.kept] @ found.values
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.01


def test_the_arm_has_the_links(found):
    np.testing.assert_allclose(inertial_parameters(found.arm().pinocchio()), found.phi, atol=1e-9)


def test_what_is_fixed_to_a_link_becomes_part_of_it(tmp_path):
    """Payloads, hands, joints that sit beside their body's origin."""
    loaded = load_arm("panda", payload=(1.5, 0.0, 0.02, 0.1))
    for arm in (loaded, load_arm(write_arms(tmp_path) / "three.xml")):
        phi = inertial_parameters(arm.pinocchio()) * 1.1
        new = with_inertias(arm, phi)
        mass = new.model().body_mass.sum() - arm.model().body_mass.sum()
        moving = phi[:, 0].sum() / 1.1
        assert mass == pytest.approx(0.1 * moving, rel=1e-9)
        mujoco.MjModel.from_xml_string(new.xml)


def test_bad_input(panda, recorded):
    refusal(lambda: identify([], panda), "one or more")
    refusal(lambda: with_inertias(panda, np.ones((6, 10))), r"\(7, 10\)")
    first = {k: getattr(recorded, k)[:60] for k in ("t", "q", "tau")}
    short = dataclasses.replace(recorded, **first)
    refusal(lambda: identify([short], panda, cutoff_hz=15.0), "expected")
