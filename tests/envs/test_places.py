"""Starts that wait: the same episodes, made together (on MuJoCo, whose arms that are not stepped
wait as well)."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.envs import tiles
from stiction_envs.envs.places import Places, PlacesAhead

N = 4
SCATTERED = {"scatter": True, "randomise": {"friction": 0.2}}


def make(kind: type[Places], monkeypatch: pytest.MonkeyPatch, **arguments: object):
    with monkeypatch.context() as patch:
        patch.setattr(tiles, "Places", kind)
        return gym.make_vec(
            "stiction_envs:PandaSJE-v0", num_envs=N, threads=1, **{**SCATTERED, **arguments}
        ).unwrapped


def action(env, k: int) -> np.ndarray:
    space, rng = env.single_action_space, np.random.default_rng(k)
    share = rng.uniform(0.2, 1.0, (N, *space.shape))
    return (space.low + share * (space.high - space.low)).astype(np.float32)


def same(a: object, b: object) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, (tuple, list)) or (isinstance(a, np.ndarray) and a.dtype == object):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.tobytes() == b.tobytes()
    return a == b


def runs(monkeypatch: pytest.MonkeyPatch, play: Callable, **arguments: object) -> list[list]:
    return [play(make(kind, monkeypatch, **arguments)) for kind in (Places, PlacesAhead)]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_same_episodes_one_after_the_other(monkeypatch, mode):
    def play(env) -> list:
        out = [env.reset(seed=2)]
        for k in range(160):
            out.append(env.step(action(env, k)))
        assert sum((o[2] | o[3]).sum() for o in out[1:]) >= 2 * N, "each arm starts anew twice"
        return out

    plain, ahead = runs(monkeypatch, play, autoreset_mode=mode, max_episode_steps=60)
    assert same(plain, ahead)


def test_seeds_options_and_numbers_drawn_between_count(monkeypatch):
    def play(env) -> list:
        out = [env.reset(seed=1)]
        mask = np.array([True, False, True, False])
        for k in range(3):
            out.append(env.step(action(env, k)))
        out.append(env.reset(options={"reset_mask": mask}))  # what waits
        out.append(env.reset(seed=9, options={"reset_mask": mask}))  # another generator
        out.append(env.reset(options={"reset_mask": mask, "joint": 6}))  # not what waits
        out.append(env.step(action(env, 7)))
        env.generators[1].random()
        out.append(env.reset())
        out.append(env.step(action(env, 8)))
        return [*out, [g.bit_generator.state["state"]["state"] for g in env.generators]]

    plain, ahead = runs(monkeypatch, play)
    assert same(plain, ahead)


def test_starts_are_made_together(monkeypatch):
    env = make(PlacesAhead, monkeypatch, max_episode_steps=20)
    begun: list[int] = []
    begin = env.core.begin
    monkeypatch.setattr(env.core, "begin", lambda ids, d: (begun.append(len(ids)), begin(ids, d)))
    env.reset(seed=0)
    ended = 0
    for k in range(100):
        _, _, terminated, truncated, _ = env.step(action(env, k))
        ended += int((terminated | truncated).sum())
    assert begun[0] == 2 * N
    assert ended >= 4 * N
    assert len(begun) - 1 <= ended / 2


def test_only_experiments_whose_arms_wait_have_starts_ahead():
    assert tiles.Places is Places
    env = gym.make_vec("stiction_envs:PandaSJE-v0", num_envs=N).unwrapped
    assert env.core.num_envs == N
    assert env.core.others_wait
    assert not gym.make_vec("stiction_envs:PandaGTE-v0", num_envs=2).unwrapped.core.others_wait
