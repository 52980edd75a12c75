import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import PANDA, same

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.vec_env import DummyVecEnv

from stiction_envs.envs.sb3 import SB3VecEnv, make_sb3
from tests.refusal import refusal

FIXED = {"control_interval_s": 0.2, "fixed_options": {"joint": 6, "load": "no_load"}}


def test_it_is_dummy_vec_env_of_singles_bit_for_bit(kind):
    last, steps = {"sje": ("reduction", 45), "gte": ("error", 20)}[kind.name]
    mine = make_sb3(kind.panda, 3, fixed_options=kind.options, **kind.arguments)
    theirs = DummyVecEnv([lambda: kind.make(fixed_options=kind.options)] * 3)
    assert mine.observation_space == theirs.observation_space
    for env in (mine, theirs):
        env.seed(3)
    assert np.array_equal(mine.reset(), theirs.reset())
    assert same(mine.reset_infos, theirs.reset_infos)
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(steps):
        action = rng.uniform(-1.0, -0.2, (3, 14)).astype(np.float32)
        a, b = mine.step(action), theirs.step(mine.scale(action))
        for x, y in zip(a[:3], b[:3], strict=True):
            assert x.dtype == y.dtype
            assert np.array_equal(x, y)
        for x, y, done in zip(a[3], b[3], a[2], strict=True):
            assert x.keys() == y.keys()
            ended += done
            if done:
                assert np.array_equal(x["terminal_observation"], y["terminal_observation"])
                assert np.array_equal(x[last], y[last])
                assert np.isfinite(x[last]).all()
                assert x["TimeLimit.truncated"] is y["TimeLimit.truncated"] is False
        assert same(mine.reset_infos, theirs.reset_infos)
    assert ended >= 3


def test_truncation_is_told():
    env = make_sb3("PandaSJE-v0", 2, max_episode_steps=2, **FIXED)
    env.reset()
    env.step(-np.ones((2, 14)))
    _, _, done, infos = env.step(-np.ones((2, 14)))
    assert done.all()
    assert all(i["TimeLimit.truncated"] for i in infos)
    assert all(np.isnan(i["tau_sje"]) for i in infos)


def test_the_rest_of_the_interface():
    env = make_sb3("PandaSJE-v0", 2, **FIXED)
    assert env.render_mode is None
    assert env.get_attr("observation_names")[1][0] == "displacement_1"
    assert env.env_is_wrapped(gym.Wrapper) == [False, False]
    assert len(env.env_method("render", indices=[0])) == 1
    env.set_attr("note", 1)
    assert env.get_attr("note", 0) == [1]
    env.close()


def test_a_next_step_batch_is_refused():
    refusal(lambda: SB3VecEnv(gym.make_vec(PANDA, 2)), "SameStep")
