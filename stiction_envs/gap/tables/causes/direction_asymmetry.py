"""Dry friction that differs by direction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.tables.causes.base import Array, Hypothesis, Index, Wheres, only
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset
from stiction_envs.gap.tables.readings import TableData

LEAST_STICTION = 1e-6
"""Stiction of a direction without any [N·m]: the least that `FrictionParameters` allow."""
LEAST, MOST = -0.9, 9.0
"""Range of a direction's friction less the mean, over it [-]; assumed, keeps friction positive."""


@dataclass(frozen=True)
class DirectionAsymmetry(TorqueOffset):
    """The + and − torques are shifted, and dither shrinks the shift."""

    name, parameter, units = "direction_asymmetry", "asymmetry_nm", {"asymmetry_nm": "N·m"}
    tell_apart: ClassVar[Mapping[str, str]] = {}
    replaces_offset: bool = False
    """Whether it replaces an offset of the same size, which a nominal model has that was calibrated
    to the base torques: they do not distinguish the two."""

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield hypotheses with and without an offset that it replaces."""
        for where in wheres.values():
            yield Hypothesis(self, where)
            yield Hypothesis(DirectionAsymmetry(replaces_offset=True), where)

    def added(self, data: TableData, rows: Index) -> Array | None:
        """Return the offset that is replaced."""
        return -data.readings.sign[rows] if self.replaces_offset else None

    def level(self, data: TableData, rows: Index, x: Array) -> Array | None:
        """Return the logarithm of the factor on the friction of each direction."""
        relative = x[:, None] * data.readings.sign[rows] / data.unit[rows]
        return np.log1p(np.clip(relative, LEAST, MOST))

    def more_parameters(
        self, estimate: Estimate, joint: int, data: TableData
    ) -> dict[str, Estimate]:
        """Return the offset that is replaced."""
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
