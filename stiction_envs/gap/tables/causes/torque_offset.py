"""A constant torque on a joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import THIRD_POSE, Array, Hypothesis, TableCause, only
from stiction_envs.gap.tables.readings import TableData

SIZE = 0.15
"""Prior size of an added torque over friction [-]; assumed."""
MOST = 0.8
"""Largest added torque over friction [-]; assumed."""
STRONG = "a dither that takes away a third of the torque or more: an added torque stays as it was"


class TorqueOffset(TableCause):
    """The + and − torques are shifted, and dither does not shrink the shift."""

    name, parameter = "torque_offset", "offset_nm"
    trials: ClassVar[tuple[float, ...]] = (1.0,)
    tell_apart: ClassVar[Mapping[str, str]] = {
        "gravity_error": THIRD_POSE,
        "direction_asymmetry": STRONG,
    }

    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the size of the torque [N·m]."""
        return SIZE * float(data.unit[list(h.rows)].min())

    def bounds(self, data: TableData, h: Hypothesis) -> tuple[float, float]:
        """Return the range of the torque [N·m]."""
        most = MOST * float(data.unit[list(h.rows)].min())
        return -most, most

    def torque(self, data: TableData, h: Hypothesis) -> Array | None:
        """Return the torque along the ramp."""
        return np.asarray(data.readings.sign[list(h.rows)])

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return x itself."""
        return {self.parameter: x}

    def what(self, values: Mapping[str, float]) -> str:
        """Return the torque in words."""
        return f"an added torque of {values[self.parameter]:+.3g} N·m"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the offset with it."""
        return {"offset": friction.offset[j] + only(values, "offset_nm")}
