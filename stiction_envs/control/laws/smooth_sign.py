"""Coulomb friction in the sense of the measured speed, smoothed: what Panda users run by default.

    τ = g · tanh(q̇/v)

crisp_controllers adds φ1/(1 + e^(−φ2 (q̇ + φ3))) − φ1/(1 + e^(−φ2 φ3)) per joint, with the numbers
of Gaz et al. (RA-L 2019, Dynamic Identification of the Franka Emika Panda, supplement). Without
φ3, the directions' difference, that is φ1/2 tanh(φ2 q̇/2): g = φ1/2 and v = 2/φ2. It does nothing
for a joint that rests. Behind a delay T its slope at rest g/v is a negative damping −g/v: a joint
whose own damping d is smaller does not come to rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import SPEED, Array, Law, coulomb, smoothing_speed
from stiction_envs.friction.parameters import FrictionParameters

_SPEED = 0.24
"""Speed at which the tanh is 76 % of its gain [rad/s]; Gaz et al. 2019, supplement: 2/φ2 of the
Panda's sigmoid, as crisp_controllers takes it, median of the joints."""


class SmoothSign(Law):
    """Coulomb friction in the sense of the measured speed."""

    name: ClassVar = "smooth_sign"
    words: ClassVar = "smooth sign of the speed"
    what: ClassVar = "Coulomb friction by the smoothed sign of the measured speed"
    knows: ClassVar = "the Coulomb friction and a speed"
    fields: ClassVar = (smoothing_speed(_SPEED),)

    def gains(self, friction: FrictionParameters, load: Array) -> Mapping[str, Array]:
        """Return the Coulomb friction as gain."""
        return {"gain": coulomb(friction, load)}

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return g tanh(q̇/v) [N·m]."""
        return numbers[0] * np.tanh(seen[SPEED] * numbers[1])


LAW = SmoothSign()
