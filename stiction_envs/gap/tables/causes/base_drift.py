"""Friction that moved between two measuring days."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import BASE_AGAIN, Array, Hypothesis
from stiction_envs.gap.tables.causes.friction_level import FrictionLevel
from stiction_envs.gap.tables.readings import Readings


class BaseDrift(FrictionLevel):
    """Dithered torques are off by one factor, and base torques are not."""

    name = "base_drift"
    log_size = 0.1
    tell_apart: ClassVar[Mapping[str, str]] = {"corrupted_cell": BASE_AGAIN}

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield hypotheses about the dithered torques of both poses, a pose, a configuration."""
        for h in super().hypotheses(readings):
            rows = tuple(i for i in h.rows if not readings.base[i])
            yield Hypothesis(self, h.joints, rows, h.scope)
        for joint in readings.joints:
            yield from (
                Hypothesis(self, (joint,), rows, f"{where.load} {where.direction}")
                for where, rows in readings.dithered(joint).items()
            )

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return nothing: the model is of the day of the base torques."""
        return {}

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that the model is not of that day."""
        return "friction of another day"
