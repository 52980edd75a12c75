"""Rewards of the GTE environment: terms, units, and the steps that pay."""

import numpy as np
import pytest

from tests.envs.helpers import GTE, IIWA_GTE, PANDA_GTE, TRIANGLE, episode, make_gte, mild
from tests.envs.test_gte import QUIET, shaken


@pytest.mark.slow
def test_undithered_iterations_sum_to_minus_one():
    """The unit of the reward is the mean over the ten iterations that `stiction gte` runs."""
    env = GTE.make_batch(10, autoreset_mode="SameStep")
    still = np.tile(env.single_action_space.low, (10, 1))
    env.reset(options=[{**TRIANGLE, "iteration": k} for k in range(10)])
    total, tracking, settling = np.zeros((3, 10))
    error, left = np.zeros((10, 6)), np.zeros((10, 2))
    alive = np.ones(10, dtype=bool)
    while alive.any():
        _, reward, terminated, _, infos = env.step(still)
        total[alive] += reward[alive]
        for i in np.flatnonzero(alive & terminated):
            final = infos["final_info"]
            tracking[i], error[i] = final["tracking_error"][i], final["error"][i]
            settling[i], left[i] = final["settling_error"][i], final["error_left"][i]
            base, base_left = final["undithered_error"][i], final["undithered_error_left"][i]
        alive &= ~terminated
    assert tracking.mean() == pytest.approx(1.0, abs=1e-12)
    assert error.mean(axis=0) == pytest.approx(base, rel=1e-12)
    assert settling.mean() == pytest.approx(1.0, abs=1e-12)
    assert left.mean(axis=0) == pytest.approx(base_left, rel=1e-12)
    # without dither only the shaking of the motion itself is left to penalise
    error_sum = 0.75 * settling + 0.25 * tracking
    assert np.all(total < -error_sum)
    assert total == pytest.approx(-error_sum, abs=0.01)
    assert total.mean() == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("name", [PANDA_GTE, IIWA_GTE])
def test_rewards_sum_to_the_tracking_error_and_the_penalties(name):
    env = make_gte(name)
    steps = episode(env, shaken(env), seed=2, options=TRIANGLE)
    final = steps[-1][4]
    assert steps[-1][2]
    terms = [s[4]["reward_terms"] for s in steps[1:]]
    assert all(("error" in s[4]) == (s is steps[-1]) for s in steps)
    tracking, settling = (sum(t[name] for t in terms) for name in ("tracking", "settling"))
    assert tracking == pytest.approx(-0.25 * final["tracking_error"], rel=1e-12)
    assert settling == pytest.approx(-0.75 * final["settling_error"], rel=1e-12)
    core, unit = env.unwrapped.core, env.unwrapped.core._unit_left[0, :3]
    ratio = core.recorder.left[0, :3] / unit
    assert final["settling_error"] == pytest.approx(ratio.mean(), rel=1e-12)
    assert final["undithered_error_left"] == pytest.approx(unit.mean(axis=0), rel=1e-12)
    assert np.array_equal(final["undithered_resting_error"], unit[-1])
    for term in ("power", "shaking"):
        assert all(t[term] < 0 for t in terms)
    assert all((t["torque_rate"] == 0) == (name == IIWA_GTE) for t in terms)
    # weight x share of the run, for this dither: 6 of 7 joints at 0.3 of their A_max
    full = sum(t["power"] for t in terms) / (0.01 * 6 / 7 * 0.3**2)
    assert full == pytest.approx(-1.0, abs=0.1)
    assert final["error"].shape == final["undithered_error"].shape == (6,)
    assert np.isfinite(final["error"]).all()
    assert 0 < final["duration"] <= final["time"] - 1
    assert final["goals_reached"] == 3


def test_weights_can_be_zero(panda):
    for weight, name in ((0.0, "tracking_error"), (1.0, "settling_error")):
        env = make_gte(settling_weight=weight, **QUIET)
        steps = episode(env, mild(env, 6), seed=1, options=TRIANGLE)
        final = steps[-1][4]
        assert sum(s[1] for s in steps) == pytest.approx(-final[name], rel=1e-12)


def test_settling_is_paid_when_the_time_at_a_goal_is_over(panda):
    """In the step in which the next goal is accepted, and in the last: nowhere else."""
    steps = episode(panda, mild(panda, 6), seed=1, options=TRIANGLE)[1:]
    paid = [k for k, s in enumerate(steps) if s[4]["reward_terms"]["settling"] < 0]
    reached = [s[4]["goals_reached"] for s in steps]
    over = [reached.index(1), reached.index(2), len(steps) - 1]
    assert paid == over
    core = panda.unwrapped.core
    left, base = core.recorder.left[0, :3], core._unit_left[0, :3]
    assert np.array_equal(steps[-1][4]["resting_error"], left[-1])
    share = 0.75 * (left / base).mean(axis=1) / 3
    assert [steps[k][4]["reward_terms"]["settling"] for k in paid] == pytest.approx(-share)
