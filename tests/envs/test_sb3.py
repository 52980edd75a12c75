from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.errors import StictionError
from tests.envs.helpers import PANDA, PANDA_GTE, QUICK, TRIANGLE, sprint

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from stiction_envs.envs.sb3 import SB3VecEnv, make_sb3

FIXED = {"control_interval_s": 0.2, "fixed_options": {"joint": 6, "load": "no_load"}}
FIXED_GTE = {"control_interval_s": 0.2, "motion": sprint(), "fixed_options": TRIANGLE}


def test_it_is_dummy_vec_env_of_singles_bit_for_bit():
    mine = make_sb3("PandaSJE-v0", 3, rescale=False, **FIXED)
    theirs = DummyVecEnv([lambda: gym.make(PANDA, **FIXED)] * 3)
    assert mine.observation_space == theirs.observation_space
    assert mine.action_space == theirs.action_space
    for env in (mine, theirs):
        env.seed(3)
    assert np.array_equal(mine.reset(), theirs.reset())
    assert mine.reset_infos == theirs.reset_infos
    rng, low, high = np.random.default_rng(0), mine.action_space.low, mine.action_space.high
    ended = 0
    for _ in range(45):
        action = (low + rng.uniform(0, 0.4, (3, 14)) * (high - low)).astype(np.float32)
        a, b = mine.step(action), theirs.step(action)
        for x, y in zip(a[:3], b[:3], strict=True):
            assert x.dtype == y.dtype
            assert np.array_equal(x, y)
        for x, y, done in zip(a[3], b[3], a[2], strict=True):
            assert x.keys() == y.keys()
            ended += done
            if done:
                assert np.array_equal(x["terminal_observation"], y["terminal_observation"])
                assert x["reduction"] == y["reduction"]
                assert x["TimeLimit.truncated"] is y["TimeLimit.truncated"] is False
        assert mine.reset_infos == theirs.reset_infos
    assert ended >= 3


def test_gte_is_dummy_vec_env_of_singles_bit_for_bit():
    mine = make_sb3("PandaGTE-v0", 2, rescale=False, **FIXED_GTE)
    theirs = DummyVecEnv([lambda: gym.make(PANDA_GTE, **FIXED_GTE)] * 2)
    for env in (mine, theirs):
        env.seed(3)
    assert np.array_equal(mine.reset(), theirs.reset())
    low, high = mine.action_space.low, mine.action_space.high
    rng, ended = np.random.default_rng(0), 0
    for _ in range(20):
        action = (low + rng.uniform(0, 0.4, (2, 14)) * (high - low)).astype(np.float32)
        a, b = mine.step(action), theirs.step(action)
        for x, y in zip(a[:3], b[:3], strict=True):
            assert np.array_equal(x, y)
        for x, y, done in zip(a[3], b[3], a[2], strict=True):
            assert x.keys() == y.keys()
            ended += done
            if done:
                assert np.array_equal(x["terminal_observation"], y["terminal_observation"])
                assert np.array_equal(x["error"], y["error"])
                assert np.isfinite(x["error"]).all()
    assert ended >= 2


def test_truncation_is_told():
    env = make_sb3("PandaSJE-v0", 2, max_episode_steps=2, **FIXED)
    env.reset()
    env.step(-np.ones((2, 14)))
    _, _, done, infos = env.step(-np.ones((2, 14)))
    assert done.all()
    assert all(i["TimeLimit.truncated"] for i in infos)
    assert all(np.isnan(i["tau_sje"]) for i in infos)


def test_scaled_actions_reach_the_bounds_exactly():
    env = make_sb3("PandaSJE-v0", 2, **FIXED)
    space = env.env.single_action_space
    assert np.array_equal(env.scale(-np.ones(14)), space.low)
    assert np.array_equal(env.scale(np.ones(14)), space.high)
    env.reset()
    env.step(-np.ones((2, 14), dtype=np.float32))
    assert not env.env.unwrapped.core.rig.dither.amplitude.any()


def test_seeds_and_options_are_used_once():
    env = make_sb3("PandaSJE-v0", 2, control_interval_s=0.2)
    env.set_options([{"joint": 2}, {"joint": 5}])
    env.seed(4)
    first = env.reset()
    assert [i["joint"] for i in env.reset_infos] == [2, 5]
    env.set_options([{"joint": 2}, {"joint": 5}])
    env.seed(4)
    assert np.array_equal(env.reset(), first)
    env.set_options({"joint": 3})
    env.reset()
    assert [i["joint"] for i in env.reset_infos] == [3, 3]


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
    with pytest.raises(StictionError, match="SameStep"):
        SB3VecEnv(gym.make_vec(PANDA, 2))


def test_without_stable_baselines_one_line_says_what_to_install():
    code = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "from stiction_envs.errors import StictionError\n"
        "try:\n    import stiction_envs.envs.sb3\n"
        "except StictionError as error:\n    print(error)\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len(out.stdout.splitlines()) == 1
    assert "pip install 'stiction-envs[rl]'" in out.stdout


@pytest.mark.slow
def test_ppo_learns_on_the_batch():
    arguments = {**FIXED, "control_interval_s": 0.1}
    env = VecNormalize(VecMonitor(make_sb3("PandaSJE-v0", 16, **arguments)))
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=256, n_epochs=4, seed=0, device="cpu")
    model.learn(4096)
    episodes = model.ep_info_buffer
    assert episodes is not None
    assert len(episodes) >= 16
    assert all(np.isfinite(e["r"]) for e in episodes)


@pytest.mark.slow
def test_ppo_learns_on_the_single_environment():
    env = gym.make(PANDA, control_interval_s=0.05, fixed_options=QUICK)
    env = gym.wrappers.RescaleAction(env, -1, 1)
    model = PPO("MlpPolicy", env, n_steps=256, batch_size=128, n_epochs=2, seed=0, device="cpu")
    model.learn(4096)
    assert model.num_timesteps == 4096


@pytest.mark.slow
def test_ppo_learns_on_the_gte_batch():
    env = VecNormalize(VecMonitor(make_sb3("PandaGTE-v0", 16, **FIXED_GTE)))
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=256, n_epochs=4, seed=0, device="cpu")
    model.learn(1536)
    episodes = model.ep_info_buffer
    assert episodes is not None
    assert len(episodes) >= 16
    assert all(-3 < e["r"] < 0 for e in episodes)
