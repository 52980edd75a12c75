"""Friction that grows with speed: τ = F_v q̇, F_v in `viscous_nms`."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import (
    DAMPING,
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


class ViscousFriction(Cause):
    """A torque in proportion to speed."""

    name: ClassVar[str] = "viscous_friction"
    what: ClassVar[str] = "slope of friction with speed"
    what_to_record: ClassVar[str] = "constant speed in both directions, slow to fast"
    adds_to: ClassVar[str] = DAMPING
    parameters: ClassVar = (Parameter("viscous_nms", "N·m·s/rad", 0.0),)
    view: ClassVar = View("joint speed [rad/s]", variable("dq"), note="a slope with speed")

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a twentieth of what the joint can bear, at 1 rad/s [N·m·s/rad]; assumed."""
        return Prior(np.array([0.05 * data.strength[joint]]), odds=1.0, everywhere=True)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the speed."""
        return data.dq[:, joint, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Raise the slope."""
        draft.values["viscous"][part.joint - 1] += part.coefficients[0]
