"""A batch of any size and number of threads equals its single environments, bit for bit."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from tests.envs.helpers import TRIANGLE, divided, same
from tests.refusal import refusal

N = 5
FIXED = {"sje": {"fixed_options": {"joint": 6}}, "gte": {}}
"""Arguments of each experiment with which episodes end at different times."""


def actions(env: VectorEnv, count: int) -> list[np.ndarray]:
    """Return small dithers of each environment's own strength, so that episodes end apart."""
    rng, space = np.random.default_rng(1), env.single_action_space
    share = np.linspace(0.0, 0.4, env.num_envs, dtype=np.float32)[:, None]
    drawn = rng.uniform(size=(count, env.num_envs, *space.shape)).astype(np.float32)
    return list(space.low + share * drawn * (space.high - space.low))


@pytest.mark.parametrize(
    ("mode", "more"),
    [("NextStep", {}), ("SameStep", {"sensing": "robot", "randomise": {"friction": 0.2}})],
)
def test_a_batch_is_its_single_environments_bit_for_bit(kind, mode, more):
    """Against Gymnasium's own SyncVectorEnv of singles: values, masks, resets and all."""
    arguments = {**FIXED[kind.name], **more}
    batch = kind.make_vec(N, autoreset_mode=mode, **arguments)
    singles = SyncVectorEnv([lambda: kind.make(**arguments)] * N, autoreset_mode=mode)
    assert batch.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert batch.observation_space == singles.observation_space
    assert batch.action_space == singles.action_space
    assert same(batch.reset(seed=7), singles.reset(seed=7))
    ended = np.zeros(N, dtype=int)
    together = 0
    for action in actions(batch, {"sje": 45, "gte": 30}[kind.name]):
        mine, theirs = batch.step(action), singles.step(action)
        assert same(list(mine), list(theirs))
        over = mine[2] | mine[3]
        ended += over
        together += over.all()
    assert ended.min() >= 1, "every environment went through an autoreset"
    assert together == 0, "some were reset while others went on"


def test_disabled_autoreset_wants_a_reset_mask(kind):
    last, drawn = {"sje": ("tau_sje", "_joint"), "gte": ("error", "_stiffness")}[kind.name]
    options = {"fixed_options": kind.options, "max_episode_steps": 2}
    env = kind.make_batch(2, autoreset_mode="Disabled", **options)
    env.reset(seed=0)
    still = np.tile(env.single_action_space.low, (2, 1))
    env.step(still)
    _, _, _, truncated, infos = env.step(still)
    assert truncated.all()
    assert np.isnan(infos[last]).all()
    refusal(lambda: env.step(still), "reset")
    _, infos = env.reset(options={"reset_mask": np.array([False, True])})
    assert infos[drawn].tolist() == [False, True]
    refusal(lambda: env.step(still), "environment 0")
    refusal(lambda: env.reset(options={"reset_mask": [1, 0]}), "reset_mask")


def test_a_partial_first_reset_is_seen_and_not_stepped(kind):
    env = kind.make_batch(2, fixed_options=kind.options)
    observation, _ = env.reset(seed=0, options={"reset_mask": np.array([True, False])})
    assert np.isfinite(observation).all()
    refusal(lambda: env.step(np.tile(env.single_action_space.low, (2, 1))), "never started")


def test_options_for_all_and_for_each(kind):
    each, wrong = {
        "sje": ([{"joint": 2, "load": "load"}, {"joint": 7}], {"joint": 9}),
        "gte": (
            [{"trajectory": "pentagon", "stiffness": (200, 20, 0)}, TRIANGLE],
            {"stiffness": 1},
        ),
    }[kind.name]
    env = kind.make_batch(2)
    for given in (kind.options, each):
        _, infos = env.reset(seed=0, options=given)
        for i, row in enumerate([given] * 2 if isinstance(given, dict) else given):
            assert all(np.array_equal(infos[name][i], value) for name, value in row.items())
    for refused in ([kind.options], "joint", {"axis": 1}, [wrong, None]):
        refusal(lambda refused=refused: env.reset(options=refused))
    refusal(lambda: env.reset(seed=[1, 2, 3]), "seeds")


def test_wrong_actions_name_what_was_expected(kind):
    env = kind.make_batch(2, fixed_options=kind.options)
    env.reset(seed=0)
    refusal(lambda: env.step(np.zeros((3, 14))), "shape")
    refusal(lambda: env.step(np.full((2, 14), np.nan)), "nan")
    refusal(lambda: kind.batch(2, autoreset_mode="sometimes"), "NextStep, SameStep, Disabled")
    refusal(lambda: kind.batch(2, render_mode="human"), "render mode")


# ---- divided -------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [pytest.param("NextStep", marks=pytest.mark.slow), "SameStep"])
def test_dividing_changes_no_bit(kind, mode, monkeypatch):
    """Through resets of single batches and of all, on one thread, two, and more than cores."""
    parts = {(N, 1): [5], (2, 1): [2, 2, 1], (3, 2): [3, 2], (1, 16): [1] * 5}
    envs = [divided(monkeypatch, kind, k, N, threads=t, autoreset_mode=mode) for k, t in parts]
    sizes = [[c.num_envs for c in e.unwrapped.batches.cores] for e in envs]
    assert sizes == list(parts.values())
    whole, *others = envs
    first = whole.reset(seed=3)
    assert all(same(list(e.reset(seed=3)), list(first)) for e in others)
    ended = np.zeros(N, dtype=int)
    for action in actions(whole, 40):
        expected = whole.step(action)
        assert all(same(list(e.step(action)), list(expected)) for e in others)
        ended += expected[2] | expected[3]
    assert ended.min() >= 1


def test_bad_input_of_the_last_batch_changes_none(kind, monkeypatch):
    env, other = (divided(monkeypatch, kind, 2, N) for _ in range(2))
    good = actions(env, 2)
    bad = good[0].copy()
    bad[-1, 0] = np.nan
    for e in (env, other):
        e.reset(seed=3)
    refusal(lambda: env.step(bad), "nan")
    refusal(lambda: env.reset(options=[None] * (N - 1) + [{"nonsense": 1}]), "nonsense")
    for action in good:
        assert same(list(env.step(action)), list(other.step(action)))
