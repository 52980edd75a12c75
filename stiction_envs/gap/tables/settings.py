"""Constants of going from torque tables to causes; values are in the room's ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import Count, Positive, load_settings


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """All settings of torque tables; priors are the causes' own."""

    scatter: Positive
    """Usual scatter of a reading over friction [-]."""
    least_blocks: Count
    """Least number of blocks of (frequency, scale) for a diagnosis."""


@cache
def table_settings() -> TableSettings:
    """Return the defaults."""
    return load_settings(TableSettings, Path(__file__).parents[1] / "settings.toml", "tables")
