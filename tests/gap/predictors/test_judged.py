"""The search for the best model of joint logs."""

import numpy as np
import pytest
from scipy.signal import lfilter

from stiction_envs.arrays import rms
from stiction_envs.gap.causes import TOLERANCES, cause_named, registered
from stiction_envs.gap.judge.search import Model
from stiction_envs.gap.predictors.judged import best_of, judge, plain_friction, search_of
from stiction_envs.gap.predictors.torque import TorquePredictor, lasting
from stiction_envs.gap.predictors.torque import repeats as repeated
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden
from tests.gap.test_cases import recorded


def test_large_errors_do_not_hide_among_small_ones_whose_size_they_raised() -> None:
    """Offsets of joints 4 and 7 are usual if small errors are as large as they may be."""
    arm = load_arm("panda")
    made = recorded(arm, 0.3, 0.2, middle=arm.rest)
    made.tau[:, [3, 6]] += [0.6, -0.35]
    data = assemble(arm, prepare([made.log(noise=0.03)], cutoff_hz=20.0))
    names = {"coulomb_friction", "viscous_friction", "torque_offset", "torque_scale"}
    causes = [TOLERANCES, *(c for c in registered() if c.name in names)]
    predictor = TorquePredictor(data, causes)
    start, usual = plain_friction(predictor), (1.0, 1.0)

    def offsets(terms) -> set[int]:
        return {t.joint for t in terms if t.cause == "torque_offset"}

    predictor.problem.given(np.full(arm.n, predictor.rows), usual)
    assert offsets(search_of(predictor).climb(start).terms) < {3, 6}
    predictor.problem.given(np.full(arm.n, predictor.rows), usual)
    assert offsets(best_of(predictor, [start]).terms) == {3, 6}


def test_a_slight_pull_of_cables_is_a_small_error() -> None:
    """Links cannot stand in for the pull on the vertical axis of joint 1."""
    arm = load_arm("panda")

    def cables(q, dq, ddq):
        return np.pad(0.06 * q[:, :1] - 0.02, ((0, 0), (0, arm.n - 1)))

    data = assemble(arm, prepare([hidden(arm, cables, noise=0.02)], cutoff_hz=10.0))
    predictor = TorquePredictor(data, [TOLERANCES, cause_named("external_spring")])
    predictor.refresh(predictor.problem, [])
    left = predictor.left(predictor.problem.model([]))
    assert rms(left)[0] < 0.3 * rms(data.residual)[0]


def test_a_finished_model_has_friction_that_is_too_little_to_be_named() -> None:
    arm = load_arm("panda")
    slope = np.where(np.arange(arm.n) == 4, 0.03, 1.0)
    log = hidden(arm, lambda q, dq, ddq: slope * dq, noise=0.1)
    data = assemble(arm, prepare([log], cutoff_hz=10.0))
    friction = [cause_named("coulomb_friction"), cause_named("viscous_friction")]
    found = judge(data, [TOLERANCES, *friction])
    named = {t.joint for t in found.model.terms if t.cause == "viscous_friction"}
    assert named == {0, 1, 2, 3, 5, 6}
    parts = found.predictor.problem.split(found.terms, found.coefficients)
    each = {
        t.joint: x for t, x in zip(found.terms, parts, strict=True) if t.cause == friction[1].name
    }
    assert each[4] == pytest.approx([0.03], abs=0.005)


def test_errors_that_come_back_with_the_motion_count_once() -> None:
    """The motion has a period of ten seconds; no cause has the torque of two joints' angles."""
    arm = load_arm("panda")

    def of_two_angles(q, dq, ddq):
        out = 0.4 * dq
        out[:, 2] += 0.3 * np.sin(5 * q[:, 2] + 4 * q[:, 3])
        return out

    gained, repeats = [], []
    for seconds in (11.0, 41.0):
        log = hidden(arm, of_two_angles, seconds=seconds, noise=0.002)
        data = assemble(arm, prepare([log], cutoff_hz=10.0))
        causes = [c for c in registered() if c.name == "viscous_friction"]
        predictor = TorquePredictor(data, causes)
        slope = [t for t in predictor.candidates if t.joint == 2 and t.part == 1.0]
        evidence = predictor.refresh(predictor.problem, slope)
        repeats.append(repeated(data, predictor.rows))
        model = Model(tuple(slope), (1.0, 1.0), predictor.problem.inflation, evidence)
        predictor.repeats = predictor.lasting(model)
        predictor.refresh(predictor.problem, slope)
        gained.append(predictor.problem.score(slope) - predictor.problem.score([]))
    assert repeats == pytest.approx([1.0, 3.6], rel=0.15)
    assert gained[0] > 1
    assert gained[1] < 1.5 * gained[0]


@pytest.mark.parametrize("lags", [(4.0, 1e-3), (1.0, 1.0), (4.0, 8.0)])
def test_a_coefficient_is_as_sure_as_its_independent_errors(lags: tuple[float, float]) -> None:
    """Errors, and what is fitted, decay over their lags: the fit's variance is r times 1/Σx²."""
    rng, alike = np.random.default_rng(3), np.exp(-1 / np.array(lags))
    error, x = (
        lfilter([np.sqrt(1 - a**2)], [1, -a], rng.standard_normal((2000, 1000))) for a in alike
    )
    variance = np.mean(np.square((error * x).sum(axis=1) / np.square(x).sum(axis=1)))
    block = np.arange(error.size) // 1000
    found = lasting(error.ravel(), x.ravel(), block, rows=1)
    assert found == pytest.approx(1000 * variance, rel=0.15)


def test_a_joint_without_torque_has_independent_errors() -> None:
    still, block = np.zeros(100), np.zeros(100, dtype=np.int64)
    assert lasting(np.ones(100), still, block, rows=1) == 1.0


def test_a_worse_model_is_less_likely_however_often_the_arm_comes_back() -> None:
    """Rows weigh less where a model leaves more; that alone must not make it likelier."""
    arm = load_arm("panda")
    log = hidden(arm, lambda q, dq, ddq: 0.06 * dq, seconds=11.0, noise=0.02)
    data = assemble(arm, prepare([log], cutoff_hz=10.0))
    causes = [c for c in registered() if c.name == "viscous_friction"]
    predictor = TorquePredictor(data, causes)
    true = [t for t in predictor.candidates if t.part == 0.1]
    predictor.repeats = np.full(arm.n, 20.0)
    worse, better = (predictor.refresh(predictor.problem, x) for x in ([], true))
    costs = sum(predictor.problem.odds[t] for t in true)
    assert better + costs > worse + 3


def test_a_small_body_may_still_be_heavy() -> None:
    """A tenth of its usual mass would draw the mass to zero, since links may take its place."""
    arm = load_arm("panda")
    data = assemble(arm, prepare([hidden(arm, noise=0.02)]))
    payload = next(c for c in registered() if c.name == "payload")
    predictor = TorquePredictor(data, [payload])
    usual, near = (predictor.problem.sd(t) for t in predictor.candidates)
    assert near[0] == 0.3 * usual[0]
    assert near[1:] == pytest.approx(0.1 * usual[1:])
