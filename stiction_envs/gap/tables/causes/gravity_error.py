"""An error of the gravity model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import THIRD_POSE, Array, Index, Wheres, only
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset
from stiction_envs.gap.tables.readings import TableData

MOST = 0.5
"""Largest error of the gravity model, over gravity [-]; assumed: with more it is another arm."""


class GravityError(TorqueOffset):
    """An offset in proportion to the load of the pose."""

    name, parameter, units = "gravity_error", "share_of_gravity", {"share_of_gravity": "1"}
    tell_apart: ClassVar[Mapping[str, str]] = {"direction_asymmetry": THIRD_POSE}

    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return the range of the share [-]."""
        load = float(np.abs(data.loads[where[0].joint - 1]).max())
        most = min(super().span(data, where)[1] / max(load, 1e-9), MOST)
        return -most, most

    def added(self, data: TableData, rows: Index) -> Array | None:
        """Return the load along the ramp."""
        r = data.readings
        return r.sign[rows] * data.loads[r.joint[rows] - 1, r.pose[rows]]

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the error of the gravity model with it."""
        return {"gravity_error": friction.gravity_error[j] + only(values, self.parameter)}
