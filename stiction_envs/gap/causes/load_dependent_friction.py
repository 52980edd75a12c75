"""Dry friction that grows with the transmitted torque: τ = k |τ_load| sign(q̇)."""

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


class LoadDependentFriction(Cause):
    """Friction of gear and bearing under load."""

    name: ClassVar[str] = "load_dependent_friction"
    what: ClassVar[str] = "friction grows with transmitted torque"
    rough: ClassVar[bool] = True
    record: ClassVar[str] = "the same slow motion in poses of small and of large gravity torque"
    needs: ClassVar = ("coulomb_friction",)
    parameters: ClassVar = (Parameter("load_coefficient", "1", 0.0, 1.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the load's size in the direction of motion."""
        return data.smooth(data.growth(joint, np.abs(data.rigid[:, joint])))[:, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return k [-]."""
        return {"load_coefficient": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether directions or a change of load are missing."""
        load = np.abs(data.rigid[:, joint])
        missing = lacks_both_directions(data, joint)
        if not missing and load.std() < 5 * data.noise[joint]:
            missing = f"joint {joint + 1} carries no load that changes"
        return missing
