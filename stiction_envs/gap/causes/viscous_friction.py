"""Friction that grows with speed: τ = F_v q̇."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import (
    Array,
    Cause,
    Parameter,
    Shape,
    lacks_both_directions,
    moving,
)
from stiction_envs.gap.signals.dataset import Data


class ViscousFriction(Cause):
    """A torque in proportion to speed."""

    name: ClassVar[str] = "viscous_friction"
    what: ClassVar[str] = "slope of friction with speed"
    law: ClassVar[bool] = True
    record: ClassVar[str] = "constant speed in both directions, slow to fast"
    parameters: ClassVar = (Parameter("viscous_nms", "N·m·s/rad", 0.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the speed."""
        return data.dq[:, joint, None]

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return non-negative, or any where the nominal model has friction to be corrected."""
        return np.array([-np.inf if data.has_friction else 0.0]), np.array([np.inf])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return F_v [N·m·s/rad]."""
        return {"viscous_nms": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether directions or a spread of speeds are missing."""
        missing = lacks_both_directions(data, joint)
        speed = np.abs(data.dq[moving(data, joint), joint])
        if not missing and speed.std() < 0.1 * speed.mean():
            missing = f"joint {joint + 1} moves at one speed only"
        return missing
