"""Dry friction that differs by direction: F_+ − F_− = 2a, so that τ = a while the joint moves."""

from __future__ import annotations

from typing import ClassVar

from stiction_envs.gap.causes.base import (
    Array,
    Cause,
    Parameter,
    Shape,
    lacks_both_directions,
    moving,
)
from stiction_envs.gap.signals.dataset import Data


class DirectionAsymmetry(Cause):
    """Half the difference of dry friction between + and −; gone at rest."""

    name: ClassVar[str] = "direction_asymmetry"
    what: ClassVar[str] = "dry friction differs by direction"
    rough: ClassVar[bool] = True
    record: ClassVar[str] = "slow motion in both directions with long rests, against an offset"
    alone: ClassVar[bool] = False
    needs: ClassVar = ("coulomb_friction",)
    parameters: ClassVar = (Parameter("asymmetry_nm", "N·m"),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return one while the joint moves."""
        return data.smooth(data.growth(joint, data.side(joint)))[:, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return (F_+ − F_−)/2 [N·m]."""
        return {"asymmetry_nm": float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether both directions are missing; without rest it is an offset."""
        missing = lacks_both_directions(data, joint)
        if not missing and moving(data, joint).mean() > 0.999:
            missing = f"joint {joint + 1} never rests, so this is the same as an offset"
        return missing
