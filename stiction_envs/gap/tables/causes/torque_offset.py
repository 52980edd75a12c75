"""A constant torque on a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import (
    THIRD_POSE,
    Array,
    Hypothesis,
    Index,
    TableCause,
    Wheres,
    only,
)
from stiction_envs.gap.tables.readings import Comparison, TableData

MOST = 0.8
"""Largest added torque and asymmetry over friction [-]; assumed."""
STRONG = "a dither that takes away a third of the torque or more: an added torque stays as it was"


class TorqueOffset(TableCause):
    """The + and − torques are shifted, and dither does not shrink the shift."""

    name, parameter, units = "torque_offset", "offset_nm", {"offset_nm": "N·m"}
    logarithmic = False
    tell_apart: ClassVar[Mapping[str, str]] = {
        "gravity_error": THIRD_POSE,
        "direction_asymmetry": STRONG,
    }

    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return the range of the torque [N·m]."""
        most = MOST * float(data.unit[data.readings.of(where)].min())
        return -most, most

    def added(self, data: TableData, rows: Index) -> Array | None:
        """Return the torque along the ramp."""
        return data.readings.sign[rows]

    def evidence(self, some: Sequence[Hypothesis], x: Sequence[float], seen: Comparison) -> str:
        """Return what half the sum of both directions is, beyond the simulation's."""
        data, j = seen.data, some[0].joints[0]
        r = data.readings
        off = r.sign * (r.torque - seen.without)
        ratio = np.array([v.torque / r.base_of(r.torque, i) for i, v in enumerate(r.all)])
        parts = []
        for k, load in enumerate(LOADS):
            mine = (r.joint == j) & (r.pose == k)
            strong = mine & ~r.base & (ratio <= np.median(ratio[mine & ~r.base]))
            parts.append(
                f"{_mean(off, r.sign, mine & r.base):+.3f} N·m {load} without dither, "
                f"{_mean(off, r.sign, strong):+.3f} N·m under the stronger half of the dithers, "
                f"which leave {100 * ratio[strong].mean():.0f} % of the torque"
            )
        loads = " and ".join(f"{g:+.2f}" for g in data.loads[j - 1])
        return (
            f"joint {j}: half the sum of + and − torques exceeds the simulation's by "
            f"{'; by '.join(parts)}; the poses' loads are {loads} N·m"
        )

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the offset with it."""
        return {"offset": friction.offset[j] + only(values, "offset_nm")}


def _mean(off: Array, sign: Array, some: NDArray[np.bool_]) -> float:
    """Return the mean of the medians of both directions."""
    sides = [np.median(off[some & (sign == s)]) for s in (1.0, -1.0) if (some & (sign == s)).any()]
    return float(np.mean(sides))
