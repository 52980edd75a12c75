"""Constants of training and evaluation; values are in ``settings.toml``."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction_envs.method_settings import Count, Positive, load_settings


@dataclass(frozen=True, kw_only=True)
class AlgorithmSettings:
    """Settings of one algorithm of Stable-Baselines3."""

    envs: Count
    """Arms that are stepped together."""
    arguments: dict[str, Any]
    """Arguments of Stable-Baselines3's class by name; its defaults stand for the others.

    ``action_noise`` is the standard deviation of normal noise, in [-1, 1] of the action's range.
    """


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings of a training that hold for every algorithm."""

    evaluation_every: Count
    """Steps between two evaluations."""
    evaluation_episodes: Count
    """Episodes of each evaluation, the same ones every time."""
    final_episodes: Count
    """Episodes with other seeds on which the finished policy is compared."""
    test_paths: Count
    """Number of the first random path for evaluation; training may draw smaller numbers."""
    clip_observation: Positive
    """Bound of normalised observations [standard deviations]."""
    clip_reward: Positive
    """Bound of normalised rewards [standard deviations]."""


@dataclass(frozen=True, kw_only=True)
class PolicySettings:
    """All settings of this package."""

    ppo: AlgorithmSettings
    """Proximal policy optimisation (Schulman et al. 2017)."""
    sac: AlgorithmSettings
    """Soft actor-critic (Haarnoja et al. 2018)."""
    td3: AlgorithmSettings
    """Twin delayed deterministic policy gradient (Fujimoto et al. 2018)."""
    run: RunSettings
    """Evaluations, limits."""


@cache
def policy_settings() -> PolicySettings:
    """Return the defaults."""
    return load_settings(PolicySettings, Path(__file__).with_name("settings.toml"))
