"""Friction that falls or rises with time: τ = r t sign(q̇)."""

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

LEAST = 10.0
"""Shortest record in which a drift is looked for [s]; assumed."""


class WarmUpDrift(Cause):
    """Dry friction that changes along the record, as a gear that warms up."""

    name: ClassVar[str] = "warm_up_drift"
    what: ClassVar[str] = "friction falls or rises with time or temperature"
    rough: ClassVar[bool] = True
    record: ClassVar[str] = "the same motion repeated for tens of minutes, from cold"
    needs: ClassVar = ("coulomb_friction",)
    parameters: ClassVar = (Parameter("drift_nm_per_s", "N·m/s"),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return time in the direction of motion, on the clock of the log."""
        return data.smooth(data.growth(joint, data.t))[:, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return r [N·m/s]."""
        return {"drift_nm_per_s": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the record is too short."""
        if np.ptp(data.t) < LEAST:
            return f"the record is only {np.ptp(data.t):.1f} s long"
        return lacks_both_directions(data, joint)
