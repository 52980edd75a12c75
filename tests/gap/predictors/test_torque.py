"""The equations of joint logs."""

import numpy as np

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.predictors.torque import TorquePredictor
from tests.gap.small_logs import data_of, hidden, panda


def test_columns_taken_over_are_those_of_the_new_load_and_presliding_distances() -> None:
    """A cause that wrongly claims to be `of_motion` keeps the columns of the load before."""
    data = data_of(panda(), hidden(panda(), seconds=5.0))
    first = TorquePredictor(data, CAUSES)
    distance = data.friction.presliding_distance.copy()
    distance[2] *= 2
    loaded = data.carrying(0.3 * data.rigid + 1.0, (0.3, 0.0, -9.8)).with_presliding(distance)
    anew, after = (TorquePredictor(loaded, CAUSES, {}, x) for x in (None, first))
    assert after.candidates == anew.candidates
    same = dict.fromkeys(CAUSES, True)
    for term in anew.candidates:
        for j in anew.affected_joints(term):
            x = anew.columns(term, j)
            np.testing.assert_array_equal(after.columns(term, j), x, err_msg=str(term))
            if j != 2 and term in first.problem.numbers:
                same[anew.causes[term.cause]] &= np.array_equal(first.columns(term, j), x)
    assert all(same[c] for c in CAUSES if c.of_motion)
    assert not all(same.values())
