"""Torque that repeats with the joint angle: τ = a sin(k q + φ).

A gear's or motor's ripple pushes the same way in both directions; friction that is uneven turns
with the motion: τ = a sin(k q + φ) sign(q̇).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.logs.data import Data

LEAST = 1.25
"""Periods within the range of a joint from which on they can be counted [-]; assumed."""
THIN = 3000
"""Rows that are enough to find the periods."""
RIDGE = 1e-9 * np.eye(5)
"""Keeps waves that do not differ solvable."""
BEST = 3
"""Periods that go on to the selection."""


class PositionDependentFriction(Cause):
    """Ripple of gear, bearing or motor."""

    name: ClassVar[str] = "position_dependent_friction"
    what: ClassVar[str] = "ripple with joint angle"
    plain: ClassVar[bool] = False
    record: ClassVar[str] = "slow constant speed over a quarter turn or more, there and back"
    sharpen: ClassVar[bool] = False
    parameters: ClassVar = (
        Parameter("ripple_nm", "N·m", size=2),
        Parameter("periods_per_rev", "1/rev", 0.0, size=0),
        Parameter("phase_rad", "rad", size=0),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return sine and cosine of k q, in the direction of motion if it is friction's."""
        angle = shape[0] * data.q[:, joint]
        wave = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        if len(shape) > 1:
            wave *= data.direction(joint)[:, None]
        return data.smooth(wave)

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the periods per turn, whole numbers, that the residual shows best.

        From `LEAST` periods within the joint's range to what its speed and the sampling resolve.
        """
        q = data.q[:, joint]
        span = float(np.ptp(q))
        if span < 1e-3:
            return []
        step = float(np.percentile(np.abs(data.dq[:, joint]), 75)) * data.dt
        low = max(1, int(np.ceil(LEAST * 2 * np.pi / span)))
        high = min(400, int(2 * np.pi / max(8 * step, 1e-6)))
        count = np.arange(low, high + 1)
        if not len(count):
            return []
        # each angle weighs the same, however long the joint stays there
        thin = slice(None, None, max(1, len(q) // THIN))
        weight = np.abs(data.dq[thin, joint])
        weight = np.sqrt(np.minimum(weight, np.percentile(weight, 90)))
        base = np.stack([np.ones_like(q), q, data.direction(joint)], axis=1)[thin]
        base, r = base * weight[:, None], residual[thin] * weight
        turning = weight * data.direction(joint)[thin]
        power: dict[int, list[tuple[float, Shape]]] = {1: [], 2: []}
        for k in count.tolist():
            wave = np.stack([np.sin(k * q[thin]), np.cos(k * q[thin])], axis=1)
            for side, shape in ((weight, (float(k),)), (turning, (float(k), 1.0))):
                x = np.column_stack([wave * side[:, None], base])
                xr = r @ x
                power[len(shape)].append((float(xr @ np.linalg.solve(x.T @ x + RIDGE, xr)), shape))
        return [s for each in power.values() for _, s in sorted(each, reverse=True)[:BEST]]

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
