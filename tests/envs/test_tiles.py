"""A batch walked in tiles is the batch: same bits, same errors, whatever the tiles are."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import VectorEnv

from stiction_envs.envs.tiles import Tiles
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.episodes import GTEEpisodes
from stiction_envs.experiments.sje.episodes import SJEEpisodes
from tests.envs.helpers import PANDA, PANDA_GTE, QUICK, TRIANGLE, same, sprint

N = 5
CORES = {PANDA: SJEEpisodes, PANDA_GTE: GTEEpisodes}
ARGUMENTS: dict[str, dict[str, Any]] = {
    PANDA: {"control_interval_s": 0.2, "fixed_options": QUICK},
    PANDA_GTE: {"control_interval_s": 0.2, "motion": sprint(), "fixed_options": TRIANGLE},
}


def batch(
    monkeypatch: pytest.MonkeyPatch, name: str, per_tile: int, mode: str = "NextStep", **other: Any
) -> VectorEnv:
    """Return N environments on one thread, ``per_tile`` at most in a tile."""
    with monkeypatch.context() as m:
        m.setattr(CORES[name], "arms_per_thread", per_tile)
        arguments = {**ARGUMENTS[name], "threads": 1, **other}
        return gym.make_vec(name, N, autoreset_mode=mode, **arguments)


def tiles(env: VectorEnv) -> Tiles:
    return env.unwrapped.tiles  # type: ignore[attr-defined]


def actions(env: VectorEnv, count: int) -> list[np.ndarray]:
    """Return dithers of each environment's own strength, so that episodes end apart."""
    rng, space = np.random.default_rng(1), env.single_action_space
    share = np.linspace(0.0, 0.4, N, dtype=np.float32)[:, None]
    shape = (count, N, *space.shape)
    drawn = rng.uniform(size=shape).astype(np.float32)
    return list(space.low + share * drawn * (space.high - space.low))


@pytest.mark.parametrize("mode", [pytest.param("NextStep", marks=pytest.mark.slow), "SameStep"])
@pytest.mark.parametrize("name", [PANDA, PANDA_GTE])
def test_tiles_change_no_bit(name, mode, monkeypatch):
    """Through resets of single tiles and of all, in tiles of 5, of 2, 2 and 1, and of 1."""
    envs = [batch(monkeypatch, name, k, mode) for k in (N, 2, 1)]
    assert [[c.num_envs for c in tiles(e).cores] for e in envs] == [[5], [2, 2, 1], [1] * 5]
    whole, *tiled = envs
    first = whole.reset(seed=3)
    assert all(same(list(e.reset(seed=3)), list(first)) for e in tiled)
    ended = np.zeros(N, dtype=int)
    for action in actions(whole, 40):
        expected = whole.step(action)
        assert all(same(list(e.step(action)), list(expected)) for e in tiled)
        ended += expected[2] | expected[3]
    assert ended.min() >= 1


@pytest.mark.parametrize("name", [PANDA, PANDA_GTE])
def test_a_reset_mask_finds_its_tiles(name, monkeypatch):
    whole, tiled = (batch(monkeypatch, name, k, "Disabled") for k in (N, 2))
    mask = np.array([False, False, False, True, True])
    for env in (whole, tiled):
        env.reset(seed=3)
        env.step(actions(env, 1)[0])
    seen = [e.reset(seed=9, options={"reset_mask": mask}) for e in (whole, tiled)]
    assert same(list(seen[0]), list(seen[1]))
    assert same(*(list(e.step(actions(e, 2)[1])) for e in (whole, tiled)))


@pytest.mark.parametrize("name", [PANDA, PANDA_GTE])
def test_bad_input_of_the_last_tile_changes_none(name, monkeypatch):
    tiled, other = (batch(monkeypatch, name, 2) for _ in range(2))
    good = actions(tiled, 2)
    bad = good[0].copy()
    bad[-1, 0] = np.nan
    for env in (tiled, other):
        env.reset(seed=3)
    with pytest.raises(StictionError, match="nan"):
        tiled.step(bad)
    with pytest.raises(StictionError, match="nonsense"):
        tiled.reset(options=[None] * (N - 1) + [{"nonsense": 1}])
    for action in good:
        assert same(list(tiled.step(action)), list(other.step(action)))


def test_a_frame_is_of_its_own_environment(monkeypatch):
    whole, tiled = (batch(monkeypatch, PANDA, k, render_mode="rgb_array") for k in (N, 2))
    joints = [{**QUICK, "joint": 1 + i, "load": "load"} for i in range(N)]
    for env in (whole, tiled):
        env.reset(seed=1, options=joints)
    frames = [env.render() for env in (whole, tiled)]
    assert len(frames[0]) == len(frames[1]) == N
    # a renderer rounds some pixels by what it drew before
    far = [[np.mean(np.abs(x.astype(int) - y) > 4) for x in frames[0]] for y in frames[1]]
    assert np.array(far).argmin(axis=1).tolist() == list(range(N))
    assert np.diag(far).max() < 1e-3 < 0.1 < np.sort(far, axis=1)[:, 1].min()
    for env in (whole, tiled):
        env.close()


def test_a_tile_has_its_arms_for_every_thread():
    class Core:
        arms_per_thread = 3

        def __init__(self, num_envs: int, threads: int = 0) -> None:
            self.num_envs = num_envs

    def sizes(count: int, threads: int) -> list[int]:
        return [c.num_envs for c in Tiles(Core, count, threads=threads).cores]  # type: ignore[arg-type]

    assert sizes(1, 1) == [1]
    assert sizes(6, 2) == [6]
    assert sizes(7, 2) == [4, 3], "no tile is left with a few"
    assert sizes(20, 2) == [5, 5, 5, 5]
    found = Tiles(Core, 7, threads=2)  # type: ignore[arg-type]
    assert [found.locate(i) for i in (0, 3, 4, 6)] == [(0, 0), (0, 3), (1, 0), (1, 2)]
