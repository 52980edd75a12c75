"""When a measured joint rests, reverses or moves; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import (
    Count,
    Positive,
    Share,
    load_settings,
)


@dataclass(frozen=True, kw_only=True)
class MotionThresholds:
    """When a measured joint rests, reverses or moves."""

    rest_speed: Positive
    """Below this speed a joint may rest: a filtered log shows neither that it moves nor where
    [rad/s]. Segments that never exceed it are poses."""
    reversal_speed: Positive
    """A joint reverses between this speed and its opposite. Speeds that vary by less do not show
    lags [rad/s]."""
    stir_span: Positive
    """A joint that covers a smaller angle does not move at all [rad]."""
    hold_span: Positive
    """A joint that covers a smaller angle only holds its position [rad]."""
    travel_span: Positive
    """Least angle that a joint must turn for its motion to be informative [rad]."""
    start_span: Positive
    """A joint that turns this far in its first `start_samples` moves from the start [rad]."""
    start_samples: Count
    """See `start_span`."""
    mover_ratio: Share
    """A joint slower than this part of the fastest is only shaken by the others [-]."""


@dataclass(frozen=True, kw_only=True)
class MeasuredSettings:
    """All settings of this package."""

    motion: MotionThresholds
    """When a joint moves, for every package that asks."""


@cache
def measured_settings() -> MeasuredSettings:
    """Return the defaults."""
    return load_settings(MeasuredSettings, Path(__file__).with_name("settings.toml"))
