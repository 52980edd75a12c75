"""Something outside that pulls with position: τ = k (q − q_0)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.signals.dataset import Data


class ExternalSpring(Cause):
    """A cable, a hose, a contact."""

    name: ClassVar[str] = "external_spring"
    what: ClassVar[str] = "cable, hose or contact that pulls with position"
    record: ClassVar[str] = "static poses over the joint's whole range, other joints elsewhere"
    parameters: ClassVar = (
        Parameter("stiffness_nm_per_rad", "N·m/rad", 0.0),
        Parameter("rest_rad", "rad"),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the angle, and ones."""
        q = data.q[:, joint]
        return np.stack([q, np.ones_like(q)], axis=1)

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return a spring that pulls back, whatever its rest."""
        return np.array([0.0, -np.inf]), np.array([np.inf, np.inf])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return k [N·m/rad] and q_0 [rad]."""
        k = max(float(coefficients[0]), 1e-9)
        return {"stiffness_nm_per_rad": k, "rest_rad": -float(coefficients[1]) / k}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the joint turns too little."""
        span = float(np.ptp(data.q[:, joint]))
        return f"joint {joint + 1} turns by {span:.3f} rad only" if span < 0.1 else ""
