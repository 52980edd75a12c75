"""Constants of the environments; values and sources are in the TOML files beside this one.

``settings.toml`` has what all environments share, ``sje.toml`` and ``gte.toml`` what is their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from stiction_envs.method_settings import check_numbers, load_settings

HERE = Path(__file__).parent
Stiffness = tuple[float, float, float]
"""Translational [N/m], rotational and nullspace [N·m/rad]."""


@dataclass(frozen=True, kw_only=True)
class ActionSettings:
    """Bounds of the dither; see `layout.action_bounds`."""

    stiction_factor: float
    """Largest amplitude over the joint's largest stiction [-]."""
    lowest_frequency: float
    """[Hz]."""
    highest_frequency: float
    """[Hz]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class SJERewardSettings:
    """Weights of the SJE's penalties, and what shakes."""

    power_weight: float
    """Of the mean of (A / A_max)² [-]."""
    torque_rate_weight: float
    """Of the mean of (2πfA / torque rate limit)² [-]."""
    shaking_weight: float
    """Of (oscillation / threshold)² [-]."""
    shaking_corner: float
    """Joints oscillate above this frequency [Hz]; see `Oscillation`."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class GTERewardSettings:
    """Weights of the GTE's reward, and the unit of its shaking."""

    settling_weight: float
    """Of the error left at the goals; the rest, to 1, is the weight of tracking [-]."""
    power_weight: float
    """Of the mean of (A / A_max)² [-]."""
    torque_rate_weight: float
    """Of the mean of (2πfA / torque rate limit)² [-]."""
    shaking_weight: float
    """Of the vibration [-]."""
    shaking_unit: float
    """Of the vibration [m]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("settling_weight",))


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """What is drawn for an episode of the GTE."""

    stiffness: tuple[Stiffness, ...]
    """Of the triangle and the pentagon."""

    @property
    def unit(self) -> tuple[float, float]:
        """Stiffness that is observed as 1, the largest: [N/m], [N·m/rad]."""
        translational, rotational, _ = np.max(self.stiffness, axis=0)
        return float(translational), float(rotational)


@dataclass(frozen=True, kw_only=True)
class RandomSettings:
    """Random paths of the GTE."""

    paths: int
    """How many are drawn from."""
    undithered_iterations: int
    """Iterations whose mean is the unit of the reward."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class SJESettings:
    """All of ``sje.toml``."""

    reward: SJERewardSettings
    """Its weights."""


@dataclass(frozen=True, kw_only=True)
class GTESettings:
    """All of ``gte.toml``."""

    episode: EpisodeSettings
    """What is drawn."""
    random: RandomSettings
    """Random paths."""
    reward: GTERewardSettings
    """Its weights."""


@cache
def action_settings() -> ActionSettings:
    """Return the bounds of the dither."""
    return load_settings(ActionSettings, HERE / "settings.toml", "action")


@cache
def sje_settings() -> SJESettings:
    """Return the defaults of the SJE."""
    return load_settings(SJESettings, HERE / "sje.toml")


@cache
def gte_settings() -> GTESettings:
    """Return the defaults of the GTE."""
    return load_settings(GTESettings, HERE / "gte.toml")
