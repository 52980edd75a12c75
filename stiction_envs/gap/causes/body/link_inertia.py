"""Inertia that is missing or wrong on a joint's own axis: τ = ΔJ q̈, ΔJ in `armature_kgm2`."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import (
    ROTOR,
    Array,
    Cause,
    Parameter,
    Prior,
    Shape,
    View,
    variable,
)
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data

QUICK = 100.0
"""Acceleration of a usual rotor by all that its joint can bear [rad/s²]; assumed: 0.1 kg·m² of 12
N·m, 0.4 kg·m² of 87 N·m."""


class LinkInertia(Cause):
    """A rotor, or a link's inertia about its joint."""

    name: ClassVar[str] = "link_inertia"
    what: ClassVar[str] = "a link's or rotor's inertia wrong"
    what_to_record: ClassVar[str] = "fast reversals, a hertz or more, of each joint by itself"
    adds_to: ClassVar[str] = ROTOR
    parameters: ClassVar = (Parameter("armature_kgm2", "kg·m²"),)
    view: ClassVar = View(
        "joint acceleration [rad/s²]",
        variable("ddq"),
        note="a slope through zero",
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return the mean inertia about the joint, since rotors are chosen to match [kg·m²].

        The rotor remains positive; a rigid model has none.
        """
        low = -float(data.friction.rotor[joint])
        return Prior(
            np.array([data.own_inertia[joint] + data.strength[joint] / QUICK]),
            np.array([low]),
            np.array([np.inf]),
        )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the acceleration."""
        return data.ddq[:, joint, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Add the inertia to the rotor, which stays positive."""
        j, (more,), rotor = part.joint - 1, part.coefficients, draft.values["rotor_inertia"]
        rotor[j] += more
        if rotor[j] < 0:
            draft.leave_out(part, f"{more:+.4g} kg·m²: a rotor's is not negative")
            rotor[j] -= more
