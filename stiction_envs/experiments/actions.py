"""Action spaces of environments: what the numbers of an action are.

An action has one number per joint of every quantity, quantity by quantity. Every environment has
the action ``dither``; an experiment may offer others of `ACTIONS`, which begin with the dither.
"""

from __future__ import annotations

from dataclasses import dataclass

from stiction_envs.experiments.observation import DITHER, Group


@dataclass(frozen=True)
class Quantity:
    """One number per joint of an action."""

    what: str
    """What a message calls it."""
    unit: str
    observed: Group
    """How its last value is observed."""


AMPLITUDE = Quantity("amplitude", "N·m", DITHER[0])
FREQUENCY = Quantity("frequency", "Hz", DITHER[1])
PUSH = Quantity(
    "push gain",
    "N·m",
    Group(
        *("push", -1.0, 1.0, "1", "last push gain; −1 is 0, 0 the treatment's, +1 twice that"),
        per_joint=True,
    ),
)
DITHERED, PUSHED = "dither", "dither+push"
"""Names of the action spaces."""
ACTIONS: dict[str, tuple[Quantity, ...]] = {
    DITHERED: (AMPLITUDE, FREQUENCY),
    PUSHED: (AMPLITUDE, FREQUENCY, PUSH),
}
"""Quantities of an action, in order, by its name."""
MOST_GAIN = 2.0
"""Largest gain over the treatment's [-]: the middle of the range is the treatment's."""
