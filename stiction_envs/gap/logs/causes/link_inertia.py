"""Inertia that is missing or wrong on a joint's own axis: τ = ΔJ q̈."""

from __future__ import annotations

from typing import ClassVar

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.logs.data import Data


class LinkInertia(Cause):
    """A rotor, or a link's inertia about its joint."""

    name: ClassVar[str] = "link_inertia"
    what: ClassVar[str] = "a link's or rotor's inertia wrong"
    record: ClassVar[str] = "fast reversals, a hertz or more, of each joint by itself"
    parameters: ClassVar = (Parameter("armature_kgm2", "kg·m²", -5.0, 20.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the acceleration."""
        return data.ddq[:, joint, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return ΔJ [kg·m²]."""
        return {"armature_kgm2": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the joint accelerates too little."""
        a = float(data.ddq[:, joint].std())
        return f"joint {joint + 1} hardly accelerates" if a < 0.02 else ""
