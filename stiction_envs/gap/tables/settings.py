"""Constants of going from torque tables to causes; values are in the room's ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import Count, Positive, load_settings


@dataclass(frozen=True, kw_only=True)
class ReadingNoiseSettings:
    """The errors of readings."""

    freedom: Positive
    """Degrees of freedom of Student's t for dithered torques [-]."""
    huber: Positive
    """Size from which the loss of a base torque is linear [sd]."""
    level_sd: Positive
    """Relative standard deviation of a calibrated friction level [-]."""
    offset_sd: Positive
    """Standard deviation of a calibrated offset over friction [-]."""
    base_sd: Positive
    """Least noise of a base torque over friction [-]: a single one has no neighbours that show its
    noise."""
    least_sd: Positive
    """Least noise of a reading over friction [-]: the difference between a single ramp per cell and
    the mean over dither phases and poses."""


@dataclass(frozen=True, kw_only=True)
class TableVerdictSettings:
    """Which hypotheses are significant, and when a residual is unexplained."""

    least_gain: Positive
    """Least held-out gain of a significant hypothesis [nats]: 4 sd, for about a hundred
    hypotheses."""
    alike_nats: Positive
    """Two causes are confused if their gains differ by less than this [nats]: 400 to 1."""
    corrupted_sd: Positive
    """Least error of a corrupted reading in standard deviations [-]."""
    corrupted: Positive
    """Least error of a corrupted reading over the friction [-]."""
    least_blocks: Count
    """Least number of blocks of (frequency, scale) for a diagnosis."""
    unexplained: Positive
    """Mean square of the residual over the noise above which a joint is not explained [-]:
    readings are normal, but their noise is known only to a fifth."""


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """All settings of torque tables; the causes' own files hold the causes' ranges."""

    noise: ReadingNoiseSettings
    """The errors of readings."""
    verdict: TableVerdictSettings
    """The significance of hypotheses."""


@cache
def table_settings() -> TableSettings:
    """Return the defaults."""
    return load_settings(TableSettings, Path(__file__).parents[1] / "settings.toml", "tables")
