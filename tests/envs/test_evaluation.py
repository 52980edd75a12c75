"""One function evaluates every agent; its rows are the environment's info."""

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.envs.agents import GatedTable, NoDither, RandomDither
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.errors import StictionError
from tests.envs.helpers import GTE, KINDS, QUICK, SJE, TRIANGLE, episode, same
from tests.refusal import refusal

OPTIONS = {
    "gte": [TRIANGLE, {"path": 101}, {"trajectory": "pentagon"}, TRIANGLE, {"path": 102}],
    "sje": [QUICK, {**QUICK, "joint": 7}, QUICK, {**QUICK, "joint": 5}, {"joint": 6}],
}


@pytest.mark.parametrize("kind", [pytest.param("gte", marks=pytest.mark.slow), "sje"])
def test_rows_are_the_same_bits_in_any_batch(kind):
    """For any number of environments, autoreset mode and earlier episodes."""
    seeds = [3, 1, 4, 1, 5]
    rows = []
    for size, mode in ((1, "NextStep"), (2, "SameStep"), (8, "Disabled")):
        env = KINDS[kind].make_batch(size, autoreset_mode=mode, randomise={"friction": 0.2})
        rows.append(evaluate(env, RandomDither(env), seeds, OPTIONS[kind]))
    assert same(rows[0], rows[1])
    assert same(rows[0], rows[2])
    assert [r["seed"] for r in rows[0]] == seeds
    again = evaluate(env, RandomDither(env), seeds[:2], OPTIONS[kind][:2])
    assert same(again, rows[2][:2])


@pytest.mark.parametrize("kind", ["gte", "sje"])
def test_a_row_is_what_the_single_environment_says(kind):
    env = KINDS[kind].make_batch(2)
    agent = GatedTable(env, speed=np.inf)
    option = OPTIONS[kind][0]
    row = evaluate(env, agent, [4, 11], option)[1]
    single = KINDS[kind].make()
    steps = episode(
        single, agent.predict(np.zeros(single.observation_space.shape))[0], seed=11, options=option
    )
    final = steps[-1][4]
    assert row["steps"] == len(steps) - 1
    assert row["return"] == pytest.approx(sum(s[1] for s in steps), rel=1e-12)
    for name in final["reward_terms"]:
        total = sum(s[4]["reward_terms"][name] for s in steps[1:])
        assert row[f"reward_{name}"] == pytest.approx(total, rel=1e-12)
    a, f = np.split(agent.predict(steps[0][0])[0].astype(float), 2)
    top = env.single_action_space.high[:7].astype(float)
    assert row["power"] == pytest.approx(np.mean((a / top) ** 2), rel=1e-6)
    assert row["torque_rate"] == pytest.approx(np.sqrt(np.mean((2 * np.pi * f * a) ** 2)), rel=1e-6)
    assert row["terminated"] == 1
    if kind == "sje":
        assert row["reduction"] == final["reduction"]
        assert row["oscillation_mrad"] == 1e3 * final["shaking"] > 0
        assert row["joint"] == QUICK["joint"]
        return
    left = [row[f"{x}_left_{u}"] for x, u in (("position", "m"), ("orientation", "rad"))]
    assert np.array_equal(left, final["error_left"])
    assert row["orientation_resting_rad"] == final["resting_error"][1]
    assert row["undithered_position_left_m"] == final["undithered_error_left"][0]
    assert row["vibration_moving_mm"] == 1e3 * final["shaking"]
    assert row["vibration_at_rest_mm"] == 1e3 * final["shaking_at_rest"] > 0
    assert (row["trajectory"], row["stiffness_translation"]) == ("triangle", 400.0)


def test_a_truncated_episode_has_no_error_left():
    env = GTE.make_batch(2, max_episode_steps=3)
    row = evaluate(env, NoDither(env), [0], TRIANGLE)[0]
    assert (row["terminated"], row["steps"]) == (0, 3)
    assert np.isnan(row["position_left_m"])
    assert np.isnan(row["vibration_at_rest_mm"])


def test_an_agent_with_a_state_is_told_where_episodes_start():
    class Counter(NoDither):
        starts: list[list[bool]] = []  # noqa: RUF012

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            self.starts.append(episode_start.tolist())
            state = np.zeros(len(observation)) if state is None else state
            return super().predict(observation)[0], np.where(episode_start, 0, state) + 1

    env = SJE.make_batch(2)
    evaluate(env, Counter(env), [0, 1, 2], QUICK)
    starts = np.array(Counter.starts)
    assert starts[0].all()
    assert starts.sum() == 3, "and again when the third episode takes the place of one"


def test_wrong_calls():
    env = SJE.make_batch(2)
    agent = NoDither(env)
    assert evaluate(env, agent, []) == []
    with pytest.raises(StictionError, match="2 options: expected one, or 3"):
        evaluate(env, agent, [0, 1, 2], [QUICK, QUICK])
    with pytest.raises(StictionError, match="reset option 'trajectory'"):
        evaluate(env, agent, [0], {"trajectory": "triangle"})
    refusal(lambda: evaluate(env, agent, [0, -1], QUICK), "seed -1: expected whole numbers from 0")
    refusal(lambda: evaluate(gym.make("CartPole-v1"), agent, [0]), "expected a batch")
