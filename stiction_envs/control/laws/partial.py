"""A part of Coulomb and viscous friction in the sense of the measured speed, as on arms of UR.

    τ = g · tanh(q̇/v) + b · q̇

URScript's ``direct_torque`` takes ``viscous_scale`` (default 0.9, elbow 0.8) and ``coulomb_scale``
(0.8, elbow 0.7) of the manufacturer's friction model. g and b are these parts of ours: what is left
over keeps the joint passive.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import SPEED, Array, Field, Law, coulomb, smoothing_speed
from stiction_envs.friction.parameters import FrictionParameters

_SPEED = 0.025  # [rad/s], assumed: as the feedforward's
_COULOMB_SCALE = 0.8  # URScript's coulomb_scale of all joints but the elbow (0.7)
_VISCOUS_SCALE = 0.9  # URScript's viscous_scale of all joints but the elbow (0.8)


class Partial(Law):
    """Part of the sliding friction in the sense of the measured speed."""

    name: ClassVar = "partial"
    words: ClassVar = "partial friction compensation"
    what: ClassVar = "a part of Coulomb and viscous friction by the measured speed"
    knows: ClassVar = "Coulomb and viscous friction, and a speed"
    fields: ClassVar = (
        smoothing_speed(_SPEED),
        Field(name="viscous", column="viscous_nms_rad", unit="N·m·s/rad", default=0.0, scales=True),
    )

    def gains(self, friction: FrictionParameters, load: Array) -> Mapping[str, Array]:
        """Return the parts of both."""
        return {
            "gain": _COULOMB_SCALE * coulomb(friction, load),
            "viscous": _VISCOUS_SCALE * friction.viscous.mean(axis=-1),
        }

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return g tanh(q̇/v) + b q̇ [N·m]."""
        v = seen[SPEED]
        return numbers[0] * np.tanh(v * numbers[1]) + numbers[2] * v


LAW = Partial()
