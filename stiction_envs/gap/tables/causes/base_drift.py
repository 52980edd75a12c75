"""Friction that moved between two measuring days."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.tables.causes.friction_level import BASE_AGAIN, FrictionLevel
from stiction_envs.gap.tables.data import Index, TableData


class BaseDrift(FrictionLevel):
    """Dithered torques are off by one factor, and base torques are not."""

    name = "base_drift"
    log_size = 0.1
    in_friction, not_in_friction = Cause.in_friction, "friction of another day"
    tell_apart: ClassVar[Mapping[str, str]] = {"corrupted_cell": BASE_AGAIN}

    def scopes(self, data: TableData, joint: int) -> Iterator[tuple[str, Index]]:
        """Yield both poses, each pose, and each configuration."""
        for scope, rows in super().scopes(data, joint):
            yield scope, rows[~data.base[rows]]
        for where, rows in data.dithered(joint).items():
            yield f"{where.load} {where.direction}", rows
