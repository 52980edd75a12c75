"""An error of the gravity model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import THIRD_POSE, Array, Hypothesis, only
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset
from stiction_envs.gap.tables.readings import TableData

SHARE = 0.05
"""Prior size of an error of the gravity model, over gravity [-]; assumed: of links."""
MOST = 0.5
"""Largest error of the gravity model, over gravity [-]; assumed: with more it is another arm."""


class GravityError(TorqueOffset):
    """An offset in proportion to the load of the pose."""

    name, parameter = "gravity_error", "share_of_gravity"
    tell_apart: ClassVar[Mapping[str, str]] = {"direction_asymmetry": THIRD_POSE}

    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the size of the share [-]."""
        return SHARE

    def bounds(self, data: TableData, h: Hypothesis) -> tuple[float, float]:
        """Return the range of the share [-]."""
        return -MOST, MOST

    def torque(self, data: TableData, h: Hypothesis) -> Array | None:
        """Return the load along the ramp."""
        r, rows = data.readings, list(h.rows)
        return np.asarray(r.sign[rows] * data.loads[r.joint[rows] - 1, r.pose[rows]])

    def what(self, values: Mapping[str, float]) -> str:
        """Return the share in words."""
        return f"{100 * values[self.parameter]:+.2g} % of the joint's gravity torque"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the error of the gravity model with it."""
        return {"gravity_error": friction.gravity_error[j] + only(values, self.parameter)}
