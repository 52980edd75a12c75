from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from stiction_envs.envs.sje import SJEVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.precomputed import store
from tests.envs.helpers import PANDA, QUICK, make, same

N = 5
# breaks away early, and at different times in the five environments
FIXED = {"control_interval_s": 0.2, "fixed_options": {"joint": 6}}


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
    batch = gym.make_vec(PANDA, N, autoreset_mode=mode, **FIXED)
    singles = SyncVectorEnv([lambda: gym.make(PANDA, **FIXED)] * N, autoreset_mode=mode)
    assert batch.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert batch.observation_space == singles.observation_space
    assert batch.action_space == singles.action_space
    assert same(batch.reset(seed=7), singles.reset(seed=7))
    ended = np.zeros(N, dtype=int)
    for action in actions(batch.action_space, 45):
        mine, theirs = batch.step(action), singles.step(action)
        assert same(list(mine), list(theirs))
        ended += mine[2] | mine[3]
    assert ended.min() >= 1, "every environment went through an autoreset"


def test_infos_of_an_environment_do_not_depend_on_the_batch_size():
    small, large = (SJEVectorEnv(n, **FIXED) for n in (1, 3))
    small.reset(seed=2)
    large.reset(seed=0)
    for action in actions(large.action_space, 10):
        a, b = small.step(action[2:]), large.step(action)
        assert np.array_equal(a[0][0], b[0][2])
        assert a[1][0] == b[1][2]


def test_disabled_autoreset_wants_a_reset_mask():
    env = SJEVectorEnv(2, autoreset_mode="Disabled", max_episode_steps=2, **FIXED)
    env.reset(seed=0)
    still = np.tile(env.single_action_space.low, (2, 1))
    env.step(still)
    assert env.step(still)[3].all()
    with pytest.raises(StictionError, match="reset"):
        env.step(still)
    _, infos = env.reset(options={"reset_mask": np.array([False, True])})
    assert infos["_joint"].tolist() == [False, True]
    with pytest.raises(StictionError, match="environment 0"):
        env.step(still)
    with pytest.raises(StictionError, match="reset_mask"):
        env.reset(options={"reset_mask": [1, 0]})


def test_options_for_all_and_for_each():
    env = SJEVectorEnv(2, control_interval_s=0.2)
    _, infos = env.reset(seed=0, options=QUICK)
    assert infos["joint"].tolist() == [6, 6]
    _, infos = env.reset(options=[{"joint": 2, "load": "load"}, {"joint": 7}])
    assert infos["joint"].tolist() == [2, 7]
    assert infos["load"][0] == "load"
    for wrong in ([QUICK], "joint", {"axis": 1}, [{"joint": 9}, None]):
        with pytest.raises(StictionError):
            env.reset(options=wrong)  # type: ignore[arg-type]
    with pytest.raises(StictionError, match="seeds"):
        env.reset(seed=[1, 2, 3])


def test_wrong_actions_name_what_was_expected():
    env = SJEVectorEnv(2, **FIXED)
    env.reset(seed=0)
    with pytest.raises(StictionError, match="shape"):
        env.step(np.zeros((3, 14)))
    with pytest.raises(StictionError, match="nan"):
        env.step(np.full((2, 14), np.nan))
    with pytest.raises(StictionError, match="NextStep, SameStep, Disabled"):
        SJEVectorEnv(2, autoreset_mode="sometimes")
    with pytest.raises(StictionError, match="render mode"):
        SJEVectorEnv(2, render_mode="human")


def test_the_base_does_not_depend_on_who_asked_for_it(monkeypatch):
    from stiction_envs.experiments.sje import undithered as base

    alone = make()
    alone.reset(seed=0, options=QUICK)
    value = float(alone.unwrapped.core.tau_base[0])
    monkeypatch.setenv("STICTION_CACHE", "off")
    store.forget()
    env = SJEVectorEnv(3, **FIXED)
    env.reset(seed=0)
    configuration = alone.unwrapped.core.configuration[0]
    assert base.base_torques(env.core.experiment, [configuration])[configuration] == value


def test_gymnasium_vector_wrappers_work():
    env = gym.make_vec(PANDA, 2, **FIXED)
    env = gym.wrappers.vector.RescaleAction(env, -1, 1)
    env = gym.wrappers.vector.RecordEpisodeStatistics(env)
    env.reset(seed=0)
    for _ in range(80):
        _, _, terminated, truncated, infos = env.step(-np.ones((2, 14), dtype=np.float32))
        if (terminated | truncated).any():
            break
    assert infos["episode"]["l"].max() > 5
