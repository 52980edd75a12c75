"""Dry friction that differs by direction: F_+ − F_− = 2a, so that τ = a while the joint moves."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.signals.dataset import Data


class DirectionAsymmetry(Cause):
    """Half the difference of dry friction between + and −; zero at rest."""

    name: ClassVar[str] = "direction_asymmetry"
    what: ClassVar[str] = "dry friction differs by direction"
    what_to_record: ClassVar[str] = (
        "slow motion in both directions with long rests, against an offset"
    )
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("asymmetry_nm", "N·m"),)
    view: ClassVar = View(
        "joint speed [rad/s]", variable("dq"), note="both directions lie off zero to the same side"
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a fiftieth of what the joint can bear [N·m]; assumed."""
        return Prior(np.array([0.02 * data.strength[joint]]), odds=2.0)

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether friction resists in both directions."""
        return abs(float(coefficients[0])) <= level

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return one while the joint moves."""
        return data.smooth(data.growth(joint, data.side(joint)))[:, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Split the levels of the friction tables by direction."""
        (half,) = part.coefficients
        both = np.array([half, -half])
        draft.coulomb[part.joint - 1] += both
        draft.stiction[part.joint - 1] += both
        draft.leave_out(part, "MuJoCo's friction knows no direction: the mean stands", tables=False)
