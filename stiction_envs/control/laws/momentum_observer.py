"""Friction as the disturbance that a momentum observer sees, fed back.

    r ← r + (1 − e^(−K T)) · (M Δq̇/T − (τ − C q̇) − r),    τ_comp = −s · min(max(r, −g), g)

r follows the disturbance torque d of M q̈ + C q̇ = τ + d with the time constant 1/K, since M q̈ is
what the momentum gains beyond what Coriolis torque and M's change explain (De Luca and Mattone
2003, eq. 12; used as a friction observer by Le Tien, Albu-Schäffer, De Luca and Hirzinger, IROS
2008, and Kim, arXiv 1907.00553). Here M is held between updates of the controller's model and the
gain of momentum is added up cycle by cycle, so a change of M is no disturbance.

Friction at rest equals what pushes the joint, so the command grows by up to 1/(1 − s) before it
breaks free. It is bounded by g, the breakaway torque and a margin, since friction is no larger.
Whoever pushes the arm is a disturbance too, up to g: this observer has no torque sensor behind the
friction, which those two papers have, and cannot tell a hand from friction.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import PUSHED, TORQUE, Array, Field, Law, breakaway
from stiction_envs.friction.parameters import FrictionParameters

_RATE = 30.0  # [1/s], assumed: 33 ms, an order slower than a cycle and its delays
_SHARE = 0.85
"""Share of r that is fed back, assumed: the largest amplification of what pushes a joint at rest is
then 7; on the Panda's triangle 0.8 leaves more, and with 0.95 an iiwa 7 swings by 1 to 2 mm at
rest."""
_BOUND = 1.5
"""Bound over the breakaway torque [-], assumed: friction may be half as strong again as believed;
bounded by 1, what is believed 30 % too small leaves half of the error."""


class MomentumObserver(Law):
    """Whatever the model does not explain, up to the breakaway torque and a margin."""

    name: ClassVar = "momentum_observer"
    words: ClassVar = "momentum observer"
    what: ClassVar = "the disturbance that a momentum observer sees, fed back"
    knows: ClassVar = "masses and inertias, a speed, the commanded torque; friction as bound only"
    fields: ClassVar = (
        Field(name="rate", column="rate_1_s", unit="1/s", default=_RATE, positive=True),
        Field(name="share", column="share", unit="1", default=_SHARE, largest=1.0),
    )
    searched: ClassVar = ("rate", "share")
    reads_momentum: ClassVar = True

    def gains(self, friction: FrictionParameters, load: Array) -> Mapping[str, Array]:
        """Return the bound: friction may be stronger than it is believed to be."""
        return {"gain": _BOUND * breakaway(friction, load)}

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return −s r within ±g [N·m]; state is r [N·m]."""
        seen_now = seen[PUSHED] / period - seen[TORQUE]
        state[0] -= np.expm1(-numbers[1] * period) * (seen_now - state[0])
        r = min(max(state[0], -numbers[0]), numbers[0])
        return -numbers[2] * r


LAW = MomentumObserver()
