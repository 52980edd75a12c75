"""Inertia that is missing or wrong on a joint's own axis: τ = ΔJ q̈, ΔJ in `armature_kgm2`."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data


class LinkInertia(Cause):
    """A rotor, or a link's inertia about its joint."""

    name: ClassVar[str] = "link_inertia"
    what: ClassVar[str] = "a link's or rotor's inertia wrong"
    what_to_record: ClassVar[str] = "fast reversals, a hertz or more, of each joint by itself"
    removed_first: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("armature_kgm2", "kg·m²", -5.0, 20.0),)
    view: ClassVar = View(
        "joint acceleration [rad/s²]",
        variable("ddq"),
        note="a slope through zero",
    )

    def size(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the mean inertia about the joint, since rotors are chosen to match [kg·m²]."""
        return np.array([data.own_inertia[joint]])

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the acceleration."""
        return data.ddq[:, joint, None]

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return bounds of ΔJ that keep the rotor positive; a rigid model has no rotor."""
        return np.array([-float(data.friction.rotor[joint])]), np.array([self.parameters[0].high])

    def rotor_inertia(self, coefficients: Array) -> float:
        """Return ΔJ [kg·m²]."""
        return float(coefficients[0])

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Add it to the rotor, as far as that stays positive."""
        j, (more,) = part.joint - 1, part.coefficients
        draft.rotor[j] += more
        if draft.rotor[j] < 0:
            draft.leave_out(part, f"{more:+.4g} kg·m²: a rotor's is not negative")
            draft.rotor[j] -= more
