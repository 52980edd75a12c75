"""Torque that repeats with the joint angle: τ = a sin(k q + φ)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.logs.data import Data

THIN = 3000
"""Rows that are enough to find the periods."""
BEST = 4
"""Periods that go on to the selection."""


class PositionDependentFriction(Cause):
    """Ripple of gear, bearing or motor."""

    name: ClassVar[str] = "position_dependent_friction"
    what: ClassVar[str] = "ripple with joint angle"
    record: ClassVar[str] = "slow constant speed over a quarter turn or more, there and back"
    sharpen: ClassVar[bool] = False
    parameters: ClassVar = (
        Parameter("ripple_nm", "N·m", size=2),
        Parameter("periods_per_rev", "1/rev", 0.0, size=0),
        Parameter("phase_rad", "rad", size=0),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return sine and cosine of k q."""
        angle = shape[0] * data.q[:, joint]
        return data.smooth(np.stack([np.sin(angle), np.cos(angle)], axis=1))

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the periods per turn, whole numbers, that the residual shows best.

        From two periods within the joint's range to what its speed and the sampling resolve.
        """
        q = data.q[:, joint]
        span = float(np.ptp(q))
        if span < 1e-3:
            return []
        step = float(np.percentile(np.abs(data.dq[:, joint]), 75)) * data.dt
        low = max(1, int(np.ceil(2 * 2 * np.pi / span)))
        high = min(400, int(2 * np.pi / max(8 * step, 1e-6)))
        count = np.arange(low, high + 1)
        if not len(count):
            return []
        # each angle weighs the same, however long the joint stays there
        thin = slice(None, None, max(1, len(q) // THIN))
        weight = np.abs(data.dq[thin, joint])
        weight = np.sqrt(np.minimum(weight, np.percentile(weight, 90)))
        base = np.stack([np.ones_like(q), q, data.direction(joint)], axis=1)[thin]
        power = np.empty(len(count))
        for i, k in enumerate(count):
            angle = k * q[thin]
            x = np.column_stack([np.sin(angle), np.cos(angle), base]) * weight[:, None]
            r = residual[thin] * weight
            power[i] = r @ x @ np.linalg.solve(x.T @ x + 1e-9 * np.eye(5), x.T @ r)
        best = count[np.argsort(power)[::-1][:BEST]]
        return [(float(k),) for k in sorted(best)]

    def at_edge(self, shape: Shape, shapes: list[Shape]) -> bool:
        """Never: the periods tried are the best of all."""
        return False

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return a [N·m], k [1/rev], φ [rad]."""
        return {
            "ripple_nm": float(np.hypot(*coefficients)),
            "periods_per_rev": shape[0],
            "phase_rad": float(np.arctan2(coefficients[1], coefficients[0])),
        }

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the joint turns too little."""
        span = float(np.ptp(data.q[:, joint]))
        return f"joint {joint + 1} turns by {span:.3f} rad only" if span < 0.05 else ""
