"""Constants of the tuner; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class ThesisSettings:
    """The thesis's protocol (4.2, Tables 4.5-4.9), and rules in place of its choices by hand."""

    frequencies_hz: tuple[float, ...]
    """Tried on an arm whose TOML has no ``[tuning.frequencies_hz]`` [Hz]."""
    scales: tuple[float, ...]
    """Amplitude over base torque [-]."""
    most_scale: float
    """Largest scale that is taken from a user [-]."""
    cap_half_widths: float
    """A candidate above this many friction half-widths of the joint's freest pose is dropped [-].

    It is offset and load of one pose, not friction, and would drive the joint in the other pose
    instead of dithering it. The thesis found joint 2's 3.7584 N·m "deemed too high" and replaced it
    by 1.2 by hand (Table 4.9): 3.9 half-widths; the next largest kept is 2.2.
    """

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class TuningSettings:
    """All of this room."""

    thesis: ThesisSettings
    """The thesis's protocol."""


@cache
def tuning_settings() -> TuningSettings:
    """Return the defaults."""
    return load_settings(TuningSettings, Path(__file__).with_name("settings.toml"))
