"""Dry friction that differs by direction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import Array, Hypothesis, TableCause, only
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset
from stiction_envs.gap.tables.readings import Readings, TableData

LEAST_STICTION = 1e-6
"""Stiction of a direction without any [N·m]: the least that `FrictionParameters` allow."""


@dataclass(frozen=True)
class DirectionAsymmetry(TorqueOffset):
    """The + and − torques are shifted, and dither shrinks the shift."""

    name, parameter = "direction_asymmetry", "asymmetry_nm"
    trials = TableCause.trials
    tell_apart: ClassVar[Mapping[str, str]] = {}
    replaces_offset: bool = False
    """Whether it replaces an offset of the same size, which a nominal model has that was calibrated
    to the base torques: they do not distinguish the two."""

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield hypotheses with and without an offset that it replaces."""
        for h in super().hypotheses(readings):
            yield h
            yield Hypothesis(DirectionAsymmetry(replaces_offset=True), h.joints, h.rows)

    def torque(self, data: TableData, h: Hypothesis) -> Array | None:
        """Return the offset that is replaced."""
        return -data.readings.sign[list(h.rows)] if self.replaces_offset else None

    def level(self, data: TableData, h: Hypothesis, x: float) -> Array | float | None:
        """Return the logarithm of the factor on the friction of each direction."""
        rows = list(h.rows)
        return np.asarray(np.log1p(x * data.readings.sign[rows] / data.unit[rows]))

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the asymmetry, and the offset that it replaces."""
        return {"asymmetry_nm": x} | ({"offset_nm": -x} if self.replaces_offset else {})

    def what(self, values: Mapping[str, float]) -> str:
        """Return the asymmetry in words."""
        instead = " in place of an offset" if self.replaces_offset else ""
        return f"dry friction {values['asymmetry_nm']:+.3g} N·m in +, as much less in -{instead}"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return stiction and offset with it."""
        more = only(values, "asymmetry_nm") * np.array([1, -1])
        return {
            "stiction": np.maximum(friction.stiction[j] + more, LEAST_STICTION),
            "offset": friction.offset[j] + values.get("offset_nm", 0.0),
        }
