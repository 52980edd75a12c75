"""Dry friction that differs by direction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.estimates import Estimate
from stiction_envs.gap.tables.causes.base import (
    Array,
    Hypothesis,
    Index,
    TableData,
    Wheres,
    only,
)
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset

LEAST_STICTION = 1e-6
"""Stiction of a direction that is left none [N·m]: the least that our friction allows."""


@dataclass(frozen=True)
class DirectionAsymmetry(TorqueOffset):
    """The + and − torques are shifted, and dither shrinks the shift."""

    name, parameter, units = "direction_asymmetry", "asymmetry_nm", {"asymmetry_nm": "N·m"}
    tell_apart: ClassVar[Mapping[str, str]] = {}
    replaces_offset: bool = False
    """Whether it takes the place of an offset as large: a nominal model that was calibrated to the
    base torques has that offset, whichever of the two it was."""

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield hypotheses with and without an offset that it replaces."""
        for where in wheres.values():
            yield Hypothesis(self, where)
            yield Hypothesis(DirectionAsymmetry(replaces_offset=True), where)

    def added(self, data: TableData, rows: Index) -> Array | None:
        """Return the offset that is taken away."""
        return -data.readings.sign[rows] if self.replaces_offset else None

    def level(self, data: TableData, rows: Index, x: Array) -> Array | None:
        """Return the logarithm of the factor on the friction of each direction."""
        relative = x[:, None] * data.readings.sign[rows] / data.unit[rows]
        return np.log1p(np.clip(relative, -0.9, 9.0))

    def more_parameters(
        self, estimate: Estimate, joint: int, data: TableData
    ) -> dict[str, Estimate]:
        """Return the offset that is taken away."""
        if not self.replaces_offset:
            return {}
        low, high = estimate.ci95
        value = -float(np.mean(estimate.value))
        return {"offset_nm": Estimate(value=value, ci95=(-high, -low), on_bound=estimate.on_bound)}

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return stiction and offset with it."""
        more = only(values, "asymmetry_nm") * np.array([1, -1])
        return {
            "stiction": np.maximum(friction.stiction[j] + more, LEAST_STICTION),
            "offset": friction.offset[j] + values.get("offset_nm", 0.0),
        }
