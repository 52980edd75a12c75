"""A constant torque bias."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, rests
from stiction_envs.gap.signals.dataset import Data


class TorqueOffset(Cause):
    """Zero of a sensor, or a calibration."""

    name: ClassVar[str] = "torque_offset"
    what: ClassVar[str] = "constant torque bias (sensor, calibration)"
    record: ClassVar[str] = "static poses on both sides of the joint's range, and rests in motion"
    parameters: ClassVar = (Parameter("offset_nm", "N·m"),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return ones."""
        return np.ones((len(data.t), 1))

    def alike(self, data: Data, joint: int) -> tuple[str, ...]:
        """Return friction on a joint that only holds: it bears whatever it came to rest with."""
        return ("coulomb_friction",) if rests(data, joint) else ()

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the offset [N·m]."""
        return {"offset_nm": float(coefficients[0])}
