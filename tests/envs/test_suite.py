"""Every registered environment: same seed, same bits; observations inside the space; more.

A new environment is found by its entry point and needs no line here.
"""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import VectorEnv

import stiction_envs
from tests.envs.helpers import KINDS, same

IDS = sorted(
    name
    for name, spec in gym.registry.items()
    if str(spec.entry_point).startswith(f"{stiction_envs.__name__}.")
)
SHORT = {kind.single.__name__: (kind.arguments, kind.options) for kind in KINDS.values()}
LONGEST = 200


def short(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arguments of an environment with short episodes, and options of one of them."""
    found = str(gym.spec(name).entry_point).rpartition(":")[2]
    return SHORT.get(found, ({"control_interval_s": 0.2}, {}))


def episode(env: gym.Env, seed: int, options: dict[str, Any], spoil: bool = False) -> list[Any]:
    """Return what reset and every step gave while mild random dither shook the arm.

    Args:
        env: the environment.
        seed: of the reset and of the actions.
        options: of the reset.
        spoil: overwrite every observation and ``info`` once it is copied, as a careless user may.
    """
    rng = np.random.default_rng(seed)
    low, high = env.action_space.low, env.action_space.high  # type: ignore[attr-defined]
    observation, info = env.reset(seed=seed, options=options)
    steps: list[Any] = [(observation.copy(), 0.0, False, False, dict(info))]
    while not any(steps[-1][2:4]) and len(steps) < LONGEST:
        if spoil:
            observation[:] = np.nan
            info.clear()
        action = low + rng.uniform(0, 0.3, low.shape) * (high - low)
        observation, reward, *over, info = env.step(action.astype(np.float32))
        steps.append((observation.copy(), reward, *over, dict(info)))
    return steps


@pytest.fixture(scope="module", params=IDS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def env(name: str):
    return gym.make(name, **short(name)[0])


@pytest.fixture(scope="module")
def steps(env: gym.Env, name: str) -> list[Any]:
    """One episode to its end."""
    return episode(env, 5, short(name)[1])


@pytest.fixture(scope="module")
def shaken(name: str) -> tuple[VectorEnv, np.ndarray, np.ndarray]:
    """A batch shaken at random through several resets: its observations and rewards as rows."""
    batch = gym.make_vec(name, 16, autoreset_mode="SameStep", **short(name)[0])
    batch.action_space.seed(0)
    seen, rewards = [batch.reset(seed=0)[0]], []
    for _ in range(30):
        observation, reward, *_ = batch.step(batch.action_space.sample())
        seen.append(observation)
        rewards.append(reward)
    return batch, np.array(seen), np.array(rewards)


def test_all_four_are_found():
    assert {"PandaSJE-v0", "PandaGTE-v0", "IiwaSJE-v0", "IiwaGTE-v0"} <= set(IDS)


def test_same_seed_same_bits_whatever_is_done_to_what_was_returned(env, name, steps):
    assert any(steps[-1][2:4]), "the episode ends"
    options = short(name)[1]
    assert same(episode(env, 5, options, spoil=True), steps)
    fresh = gym.make(name, **short(name)[0])
    assert same(episode(fresh, 5, options), steps)
    assert not same(episode(env, 6, options), steps)


def test_reward_is_the_sum_of_its_terms(steps):
    for _, reward, *_, info in steps[1:]:
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-15)
    assert len({tuple(s[-1]["reward_terms"]) for s in steps[1:]}) == 1


def test_what_is_seen_is_finite_and_in_the_space(env, steps, shaken):
    assert all(s[0] in env.observation_space for s in steps)
    batch, seen, rewards = shaken
    space = batch.single_observation_space
    assert seen.dtype == space.dtype
    assert np.isfinite(seen).all()
    assert np.isfinite(rewards).all()
    assert ((seen >= space.low) & (seen <= space.high)).all()


def test_no_element_is_constant(shaken):
    batch, seen, _ = shaken
    names = np.array(batch.unwrapped.observation_names)
    assert names.shape == seen.shape[2:]
    constant = np.ptp(seen.reshape(-1, len(names)), axis=0) == 0
    assert not constant.any(), names[constant]


def test_no_array_is_returned_twice(env, name):
    kept = [env.reset(seed=0, options=short(name)[1])[0]]
    kept += [env.step(env.action_space.low)[0] for _ in range(3)]
    batch = gym.make_vec(name, 2, **short(name)[0])
    kept += [batch.reset(seed=0)[0]]
    kept += [batch.step(batch.action_space.low)[0] for _ in range(3)]
    assert not any(np.shares_memory(a, b) for k, a in enumerate(kept) for b in kept[:k])
