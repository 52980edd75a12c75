"""The search for the best model of joint logs."""

import numpy as np

from stiction_envs.gap.causes import TOLERANCES, registered
from stiction_envs.gap.predictors.judged import best_of, plain_friction, search_of
from stiction_envs.gap.predictors.torque import TorquePredictor
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.robots import load_arm
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
