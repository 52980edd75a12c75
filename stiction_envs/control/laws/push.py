"""Push in the sign of the joint error, which fades with the measured speed.

    τ = (g + c |τ_g|) · tanh(e_j/w) · exp(−(q̇_j/v)²)
    e_j = (Jᵀ K e)_j / (Jᵀ K J)_jj,   e = x_d − x

It does not drive a joint that slips (almond-bot/axol#317, whose c, about 0.1, is "load_gain": g
grows with the gravity torque τ_g of the controller's model; default 0).

e_j is the angle by which joint j alone has to turn until the impedance has no torque on it. With
one joint it is the joint's error; with several it has the sign in which the joint's own motion
lowers the potential ½ eᵀ K e. (J^# e does not: a joint that alone breaks free may then move the
wrong way.) At rest the whole push acts on errors far beyond w; within w it is a spring g/w, which
vanishes with the error. A sharp push (w → 0) is a relay: if it exceeds the friction it hunts, since
the robot responds late. The Panda hunts at w = 0.00005 rad from the breakaway torque on; at
0.0005 rad it does not hunt even at four times that torque.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import (
    ERROR,
    GRAVITY,
    SPEED,
    Array,
    Field,
    Law,
    smoothing_speed,
)

_SPEED = 0.02
"""Speed at which a push has faded to 1/e [rad/s], assumed: a joint that turns faster slips; a tenth
of the joints' speed along the paths."""
_ERROR = 0.002
"""Joint error at which a push is 76 % of its gain [rad], assumed: a tenth of a degree, far above an
encoder's noise."""
_LOAD = 0.0  # Off; almond-bot/axol#317 measures about 0.1 of the gravity torque [-]


class Push(Law):
    """Friction in the sense of the joint error."""

    name: ClassVar = "push"
    words: ClassVar = "push against the error"
    what: ClassVar = "a push in the sign of the joint error that fades with the measured speed"
    knows: ClassVar = "the friction, angles and a speed; with a load gain the arm's masses too"
    fields: ClassVar = (
        smoothing_speed(_SPEED),
        Field(name="error", column="error_rad", unit="rad", default=_ERROR, positive=True,
              inverse=True),
        Field(name="load", column="load_gain", unit="1", default=_LOAD, scales=True),
    )  # fmt: skip
    searched: ClassVar = ("speed", "error")
    reads_error: ClassVar = True

    def reads_model(self, numbers: Mapping[str, Sequence[float]]) -> bool:
        """Return whether there is a load gain."""
        return any(numbers["load"])

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return (g + c |τ_g|) tanh(e/w) exp(−(q̇/v)²) [N·m]."""
        fade = seen[SPEED] * numbers[1]
        push = np.tanh(seen[ERROR] * numbers[2]) * np.exp(-fade * fade)
        return (numbers[0] + numbers[3] * abs(seen[GRAVITY])) * push


LAW = Push()
