"""Both experiments in short episodes, for the tests of the environments."""

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.gte import GTEEnv, GTEVectorEnv
from stiction_envs.envs.sje import SJEEnv, SJEVectorEnv
from tests.robots.arms import TWO

PANDA, IIWA = "stiction_envs:PandaSJE-v0", "stiction_envs:IiwaSJE-v0"
PANDA_GTE, IIWA_GTE = "stiction_envs:PandaGTE-v0", "stiction_envs:IiwaGTE-v0"
QUICK = {"joint": 6, "load": "no_load", "direction": "+"}
"""A configuration that breaks away early."""
TRIANGLE = {"trajectory": "triangle", "stiffness": (400, 40, 0)}
TURRET = TWO.replace("0 1 0", "0 0 1", 1)
"""MJCF of an arm of two joints that turns and tilts."""


def sprint() -> MotionLimits:
    """Return movements some five times as fast as the thesis's, for short episodes."""
    return MotionLimits(
        translational_acceleration=5.0,
        translational_deceleration=5.0,
        rotational_acceleration=5.0,
        rotational_deceleration=5.0,
        rotational_speed=2.0,
        patience=0.2,
    )


class Kind(NamedTuple):
    """An experiment's environments, with what makes their episodes short."""

    single: Any
    batch: Any
    arguments: dict[str, Any]
    options: dict[str, Any]
    """Everything that a reset may draw but the scatter."""
    name: str
    panda: str
    iiwa: str

    def make(self, name: str | None = None, **arguments: Any) -> gym.Env:
        """Return a single environment."""
        return gym.make(name or self.panda, **{**self.arguments, **arguments})

    def make_vec(self, count: int, **arguments: Any) -> gym.vector.VectorEnv:
        """Return a batch, as `gymnasium.make_vec` makes it."""
        return gym.make_vec(self.panda, count, **{**self.arguments, **arguments})

    def make_batch(self, count: int, **arguments: Any) -> Any:
        """Return a batch."""
        return self.batch(count, **{**self.arguments, **arguments})


SJE = Kind(SJEEnv, SJEVectorEnv, {"control_interval_s": 0.2}, QUICK, "sje", PANDA, IIWA)
LIMITS = {"control_interval_s": 0.2, "motion": sprint()}
GTE = Kind(GTEEnv, GTEVectorEnv, LIMITS, TRIANGLE, "gte", PANDA_GTE, IIWA_GTE)
KINDS = {"sje": SJE, "gte": GTE}
make, make_gte = SJE.make, GTE.make


def quiet(env: gym.Env) -> np.ndarray:
    """Return the action without dither."""
    return env.action_space.low.copy()


def mild(env: gym.Env, joint: int, *, share: float = 0.3, frequency: float = 30.0) -> np.ndarray:
    """Return the action that dithers one joint (1..n) with a share of A_max."""
    action, n = quiet(env), env.action_space.shape[0] // 2
    action[joint - 1], action[n + joint - 1] = share * env.action_space.high[joint - 1], frequency
    return action


def episode(env: gym.Env, action: Any, **reset: Any) -> list[tuple]:
    """Return what `reset` and every step gave; ``action`` is one, or a function of the step."""
    observation, info = env.reset(**reset)
    steps: list[tuple] = [(observation, 0.0, False, False, info)]
    while not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(action(len(steps)) if callable(action) else action))
    return steps


def divided(
    monkeypatch: pytest.MonkeyPatch, kind: Kind, per_batch: int, count: int, **more: Any
) -> Any:
    """Return environments in batches of at most ``per_batch`` arms, on one thread by default."""
    with monkeypatch.context() as m:
        m.setattr(kind.batch.episodes, "arms_per_batch", per_batch)
        return kind.make_vec(count, **{"threads": 1, "fixed_options": kind.options, **more})


def same(a: Any, b: Any) -> bool:
    """Return whether two results are the same bits, nested dicts and NaN included."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray) and a.dtype == object:
        return same(list(a), list(b))
    if isinstance(a, (np.ndarray, float)):
        x, y = np.asarray(a), np.asarray(b)
        return x.dtype == y.dtype and np.array_equal(x, y, equal_nan=True)
    return type(a) is type(b) and a == b
