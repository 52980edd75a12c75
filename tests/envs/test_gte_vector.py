from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from stiction_envs.envs.gte import GTEVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte import undithered as gte_base
from stiction_envs.precomputed import store
from tests.envs.helpers import PANDA_GTE, TRIANGLE, make_gte, same, sprint

N = 4
# two of the cases end early and late; the arms on one path end at different times as well
FIXED = {"control_interval_s": 0.2, "motion": sprint()}
STILL = {**FIXED, "fixed_options": TRIANGLE}


def actions(space: gym.spaces.Box, count: int) -> list[np.ndarray]:
    """Return a fixed sequence of small dithers."""
    rng = np.random.default_rng(1)
    low, high = space.low, space.high
    return [
        low + rng.uniform(0, 0.4, low.shape).astype(np.float32) * (high - low) for _ in range(count)
    ]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_is_its_single_environments_bit_for_bit(mode):
    """Against Gymnasium's own SyncVectorEnv of singles: values, masks, resets and all."""
    batch = gym.make_vec(PANDA_GTE, N, autoreset_mode=mode, **FIXED)
    singles = SyncVectorEnv([lambda: gym.make(PANDA_GTE, **FIXED)] * N, autoreset_mode=mode)
    assert batch.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert batch.observation_space == singles.observation_space
    assert batch.action_space == singles.action_space
    assert same(batch.reset(seed=7), singles.reset(seed=7))
    ended = np.zeros(N, dtype=int)
    together = 0
    for action in actions(batch.action_space, 30):
        mine, theirs = batch.step(action), singles.step(action)
        assert same(list(mine), list(theirs))
        over = mine[2] | mine[3]
        ended += over
        together += over.all()
    assert ended.min() >= 1, "every environment went through an autoreset"
    assert together == 0, "some were reset while others went on"


def test_infos_of_an_environment_do_not_depend_on_the_batch_size_or_threads():
    small, large = GTEVectorEnv(1, threads=1, **STILL), GTEVectorEnv(5, threads=2, **STILL)
    small.reset(seed=4)
    large.reset(seed=0)
    for action in actions(large.action_space, 16):
        a, b = small.step(action[4:]), large.step(action)
        assert np.array_equal(a[0][0], b[0][4])
        assert a[1][0] == b[1][4]


def test_disabled_autoreset_wants_a_reset_mask():
    env = GTEVectorEnv(2, autoreset_mode="Disabled", max_episode_steps=2, **STILL)
    env.reset(seed=0)
    still = np.tile(env.single_action_space.low, (2, 1))
    env.step(still)
    _, _, _, truncated, infos = env.step(still)
    assert truncated.all()
    assert np.isnan(infos["error"]).all()
    with pytest.raises(StictionError, match="reset"):
        env.step(still)
    _, infos = env.reset(options={"reset_mask": np.array([False, True])})
    assert infos["_stiffness"].tolist() == [False, True]
    with pytest.raises(StictionError, match="environment 0"):
        env.step(still)


def test_a_partial_first_reset_is_seen_and_not_stepped():
    env = GTEVectorEnv(2, **STILL)
    observation, _ = env.reset(seed=0, options={"reset_mask": np.array([True, False])})
    assert np.isfinite(observation).all()
    with pytest.raises(StictionError, match="never started"):
        env.step(np.tile(env.single_action_space.low, (2, 1)))


def test_a_reset_of_some_leaves_the_others_alone():
    """An arm on its way is the same bits whether its neighbour was reset meanwhile or not."""
    seen = []
    for reset in (False, True):
        env = GTEVectorEnv(2, autoreset_mode="Disabled", **STILL)
        env.reset(seed=0)
        rows = []
        for k, action in enumerate(actions(env.action_space, 8)):
            if reset and k == 3:
                env.reset(seed=9, options={"reset_mask": np.array([False, True])})
            rows.append(env.step(action)[0][0])
        seen.append(rows)
    assert np.array_equal(*seen)


def test_options_for_all_and_for_each():
    env = GTEVectorEnv(2, **FIXED)
    _, infos = env.reset(seed=0, options=TRIANGLE)
    assert infos["trajectory"].tolist() == ["triangle", "triangle"]
    assert infos["stiffness"].shape == (2, 3)
    both = [{"trajectory": "pentagon", "stiffness": (200, 20, 0)}, TRIANGLE]
    _, infos = env.reset(options=both)
    assert infos["trajectory"].tolist() == ["pentagon", "triangle"]
    assert infos["stiffness"][:, 0].tolist() == [200.0, 400.0]
    for wrong in ([TRIANGLE], "triangle", {"joint": 1}, [{"stiffness": 1}, None]):
        with pytest.raises(StictionError):
            env.reset(options=wrong)  # type: ignore[arg-type]


def test_the_unit_of_the_reward_does_not_depend_on_who_asked_for_it(monkeypatch):
    alone = make_gte()
    alone.reset(seed=0, options=TRIANGLE)
    core = alone.unwrapped.core
    key = core.case[0]
    value = gte_base.undithered(core.experiment, [key])[key]
    monkeypatch.setenv("STICTION_CACHE", "off")
    store.forget()
    env = GTEVectorEnv(2, **FIXED)
    env.reset(seed=0)
    again = gte_base.undithered(env.core.experiment, [key])[key]
    assert same(vars(again), vars(value))


def test_gymnasium_vector_wrappers_work():
    env = gym.make_vec(PANDA_GTE, 2, **STILL)
    env = gym.wrappers.vector.RescaleAction(env, -1, 1)
    env = gym.wrappers.vector.RecordEpisodeStatistics(env)
    env.reset(seed=0)
    for _ in range(30):
        _, _, terminated, truncated, infos = env.step(-np.ones((2, 14), dtype=np.float32))
        if (terminated | truncated).any():
            break
    assert infos["episode"]["r"].min() == pytest.approx(-1.0, abs=0.2)
