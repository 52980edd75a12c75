"""Excitation: laws of the motion, limits held by independent means, better than random motions."""

import dataclasses

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stiction_envs.errors import ExperimentError
from stiction_envs.identification.excitation import Excitation, excite
from stiction_envs.identification.excitation_limits import acceleration_limits
from stiction_envs.identification.excitation_motion import (
    SPEEDS,
    FourierSeries,
    rest_basis,
    sweeps_from,
)
from stiction_envs.identification.excitation_search import SIGN_SPEED, ExcitationProblem
from stiction_envs.identification.settings import excitation_settings
from stiction_envs.robots import Arm, load_arm
from tests.refusal import refusal
from tests.robots.test_overlapping_links import ARM

DEFAULTS = excitation_settings()
QUICK = dataclasses.replace(DEFAULTS, iterations=100, starts=1, randoms=6)


@pytest.fixture(scope="module")
def panda() -> Arm:
    return load_arm("panda")


@pytest.fixture(scope="module")
def motion(panda) -> Excitation:
    return excite(panda, QUICK, sweeps=True, seed=3)


def any_series(harmonics: int = 5, n: int = 3) -> FourierSeries:
    rng = np.random.default_rng(0)
    c = rng.normal(size=(n, 2 * harmonics - 2)) @ rest_basis(harmonics).T
    return FourierSeries(
        base_frequency=0.1,
        offset=rng.normal(size=n),
        sine=c[:, :harmonics],
        cosine=c[:, harmonics:],
    )


@pytest.mark.parametrize("harmonics", [2, 3, 5, 8])
def test_series_rests_at_the_start_of_every_period(harmonics):
    """Swevers's conditions: Σ a_k = 0 is zero speed, Σ k b_k = 0 zero acceleration."""
    q, dq, ddq = any_series(harmonics).state(np.array([0.0, 10.0, 20.0]))
    np.testing.assert_allclose(dq, 0, atol=1e-12)
    np.testing.assert_allclose(ddq, 0, atol=1e-12)
    np.testing.assert_allclose(q, q[[0, 0, 0]], atol=1e-12)


def test_speeds_and_accelerations_are_derivatives(motion):
    """Central differences of the angles, over series, join and sweeps."""
    t, h = np.linspace(0.01, motion.duration - 0.01, 4001), 1e-5
    before, after = motion.state(t - h), motion.state(t + h)
    _, dq, ddq = motion.state(t)
    np.testing.assert_allclose((after[0] - before[0]) / 2 / h, dq, atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / 2 / h, ddq, atol=1e-3)


def test_sweeps_go_there_and_back_at_each_speed():
    low, high = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
    slow = sweeps_from(np.array([0.9, -0.2]), low, high)
    t = np.arange(0, slow.duration, 1e-3)
    q, dq, _ = slow.state(t)
    for speed in SPEEDS:
        for sign in (1, -1):
            steady = np.abs(dq - sign * speed) < 1e-9
            assert (steady.sum(axis=0) > 100).all(), speed
    np.testing.assert_allclose(q[-1], q[0], atol=1e-9)
    assert (q >= low).all()
    assert (q <= high).all()
    assert (q[:, 0] <= 0.9 + 1e-9).all()  # towards the middle of the range


def test_limits_are_held(panda, motion):
    t = motion.times(1000.0)
    q, dq, ddq = motion.state(t)
    low, high = panda.limits.position.T
    margin = QUICK.position_margin
    assert (q > low + margin - 1e-6).all()
    assert (q < high - margin + 1e-6).all()
    assert (np.abs(dq) < QUICK.velocity_part * panda.limits.velocity + 1e-3).all()
    limit = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])  # FCI documentation
    np.testing.assert_array_equal(acceleration_limits(panda, 1.0)[0], limit)
    assert (np.abs(ddq) < QUICK.acceleration_part * limit * 1.001).all()
    model, data = panda.pinocchio(), panda.pinocchio().createData()
    tau = np.array([pin.rnea(model, data, q[k], dq[k], ddq[k]) for k in range(0, len(q), 10)])
    assert (np.abs(tau) < QUICK.torque_part * panda.limits.torque * 1.001).all()


def test_clear_of_the_floor_and_itself(panda, motion):
    """MuJoCo's own contact detection on the arm's geometry, and the flange above the floor."""
    model = panda.model()
    data = mujoco.MjData(model)
    for q in motion.state(motion.times(50.0))[0]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        assert data.ncon == 0
        assert data.site(panda.end_effector).xpos[2] > QUICK.clearance
    assert motion.clearance >= QUICK.clearance


def test_better_conditioned_than_random_motions(motion):
    assert motion.condition < 0.7 * motion.random_condition.min()
    assert motion.condition < 0.4 * np.median(motion.random_condition)


def test_stated_condition_number_is_that_of_the_regressor(panda, motion):
    """In SI units, worked out anew: 43 links' base parameters of the Panda and 21 of friction."""
    assert len(motion.columns) == 43 + 21
    problem = ExcitationProblem(panda, QUICK)
    q, dq, ddq = motion.series.state(problem.fine)
    model, data = panda.pinocchio(), panda.pinocchio().createData()
    rows = []
    for k in range(len(q)):
        w = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])
        own = [np.diag(x) for x in (np.tanh(dq[k] / SIGN_SPEED), dq[k], np.ones(7))]
        rows.append(np.hstack([w, *own])[:, problem.base.kept])
    s = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    assert motion.condition_si == pytest.approx(s[0] / s[-1], rel=1e-6)


def test_the_cost_is_the_condition_and_penalties(panda):
    """Inside all limits there is none; half as much again breaks some."""
    rng = np.random.default_rng(0)
    problem = ExcitationProblem(panda, QUICK)
    x = problem.random(rng)
    for point, penalised in ((0.9 * x, False), (1.5 * x, True)):
        plain = np.log(problem.condition(problem.series(point).state(problem.coarse)))
        assert (problem.cost(point) > plain + 0.01) == penalised


def test_same_seed_same_motion_and_progress_rises_to_one(panda):
    few = dataclasses.replace(QUICK, iterations=3, randoms=2)
    seen: list[tuple[str, float]] = []
    one, same = (excite(panda, few, seed=5) for _ in range(2))
    other = excite(panda, few, seed=6, progress=lambda *x: seen.append(x))
    np.testing.assert_array_equal(one.series.sine, same.series.sine)
    np.testing.assert_array_equal(one.series.offset, same.series.offset)
    assert np.abs(one.series.sine - other.series.sine).max() > 0.01

    search = [part for stage, part in seen if stage == "search"]
    assert search == sorted(search)
    assert search[-1] == 1.0


def test_samples_need_a_rate(motion):
    refusal(lambda: motion.times(0.0), "rate")


def test_an_arm_that_cannot_be_held_at_rest_is_said(panda):
    weak = dataclasses.replace(panda.limits, torque=np.full(7, 5.0))
    with pytest.raises(ExperimentError, match=r"at rest the torque is .* of what may be used"):
        excite(dataclasses.replace(panda, limits=weak), QUICK)


def test_neighbours_keep_half_of_what_they_have_at_rest(tmp_path):
    """A base and a second link 35 mm apart can be excited, with a note; they never touch."""
    path = tmp_path / "near.xml"
    path.write_text(ARM.format(bulge=0.03).replace('0 0 0.1"/>', '0 0 0.135"/>', 1), "utf-8")
    motion = excite(load_arm(path), QUICK)
    assert 0.0 < motion.clearance < DEFAULTS.clearance
    assert any("mm apart at rest: half of that is kept" in note for note in motion.notes)
