"""Constants of going from logs to causes; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_type_hints

from stiction_envs.measured.settings import MeasuredSettings, MotionThresholds, measured_settings
from stiction_envs.method_settings import Count, load_settings

PATH = Path(__file__).with_name("settings.toml")


@dataclass(frozen=True, kw_only=True)
class RecordingSettings:
    """How the logs' time is cut into held-out blocks."""

    blocks: Count
    """Blocks of time, over all logs, that are held out in turn: enough to see their spread."""


@dataclass(frozen=True, kw_only=True)
class GapSettings:
    """All settings of this package, and of the logs it reads."""

    measured: MeasuredSettings
    """When a joint moves."""
    recording: RecordingSettings
    """Held-out blocks of time."""

    @property
    def motion(self) -> MotionThresholds:
        """When a joint moves, as in `measured`."""
        return self.measured.motion


@cache
def gap_settings() -> GapSettings:
    """Return the defaults."""
    kinds = get_type_hints(GapSettings)
    own = {x: load_settings(kinds[x], PATH, x) for x in kinds if x != "measured"}
    return GapSettings(measured=measured_settings(), **own)
