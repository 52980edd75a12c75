"""Dry friction that is missing or wrong: τ = F_c sign(q̇)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import (
    Array,
    Cause,
    Parameter,
    Shape,
    lacks_both_directions,
)
from stiction_envs.gap.signals.dataset import Data


class CoulombFriction(Cause):
    """A torque of constant size against the motion."""

    name: ClassVar[str] = "coulomb_friction"
    what: ClassVar[str] = "dry friction missing or wrong"
    law: ClassVar[bool] = True
    rough: ClassVar[bool] = True
    record: ClassVar[str] = "constant speed in both directions, at several speeds"
    parameters: ClassVar = (Parameter("coulomb_nm", "N·m", 0.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the direction of motion."""
        return data.smooth(data.grip(joint))[:, None]

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return non-negative, or any where the nominal model has friction to be corrected."""
        return np.array([-np.inf if data.has_friction else 0.0]), np.array([np.inf])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return F_c [N·m]."""
        return {"coulomb_nm": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether both directions are missing."""
        return lacks_both_directions(data, joint)
