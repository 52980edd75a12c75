"""Friction that moved between two measuring days."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import BASE_AGAIN, Array, Hypothesis, Index, Wheres
from stiction_envs.gap.tables.causes.friction_level import FrictionLevel
from stiction_envs.gap.tables.readings import TableData


class BaseDrift(FrictionLevel):
    """Dithered torques are off by one factor, and base torques are not."""

    name = "base_drift"
    tell_apart: ClassVar[Mapping[str, str]] = {"corrupted_cell": BASE_AGAIN}

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield hypotheses about both poses, each pose, and each configuration."""
        yield from super().statements(wheres)
        yield from (Hypothesis(self, (w,)) for some in wheres.values() for w in some)

    def level(self, data: TableData, rows: Index, x: Array) -> Array | None:
        """Return the logarithm of the factor."""
        return x[:, None] * np.where(data.readings.base[rows], 0.0, 1.0)

    def indistinguishable_from(self, some: Sequence[Hypothesis]) -> tuple[str, ...]:
        """Return a bad reading, if the hypothesis is about one base torque."""
        return ("corrupted_cell",) if len(some) == 1 and len(some[0].where) == 1 else ()

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return nothing: the model is of the day of the base torques."""
        return {}

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that the model is not of that day."""
        return "friction of another day"
