"""Short episodes for the tests of the environments."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from stiction_envs.control.trajectory import MotionLimits

PANDA, IIWA = "stiction_envs:PandaSJE-v0", "stiction_envs:IiwaSJE-v0"
QUICK = {"joint": 6, "load": "no_load", "direction": "+"}
"""A configuration that breaks away early."""


def make(name: str = PANDA, **arguments: Any) -> gym.Env:
    return gym.make(name, control_interval_s=0.2, **arguments)


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


def same(a: Any, b: Any) -> bool:
    """Whether two results are the same bits, nested dicts and NaN included."""
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


# ---- GTE -----------------------------------------------------------------------------------------

PANDA_GTE, IIWA_GTE = "stiction_envs:PandaGTE-v0", "stiction_envs:IiwaGTE-v0"
TRIANGLE = {"trajectory": "triangle", "stiffness": (400, 40, 0)}


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


def make_gte(name: str = PANDA_GTE, **arguments: Any) -> gym.Env:
    return gym.make(name, **{"control_interval_s": 0.2, "motion": sprint(), **arguments})
