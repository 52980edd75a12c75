"""The note at the top of a report on an arm whose friction has not been measured."""

from __future__ import annotations

import numpy as np

from stiction_envs.friction.from_file import from_file, own_friction
from stiction_envs.friction.parameters import (
    GENERIC,
    QUANTITIES,
    FrictionParameters,
    friction_path,
    load_friction,
)
from stiction_envs.robots import Arm

ASSUMED = (
    "**The friction of this arm is assumed, not measured** (`generic.toml`): what depends on it "
    "shows how such an arm behaves, not how large the torques of yours are. To measure friction, "
    "let the robot run the motion of `stiction excite ROBOT --sweeps`, then run `stiction diagnose "
    "LOG --robot ROBOT`; every command takes the `model.toml` it writes by `--friction`. From "
    "measured breakaway torques, `stiction calibrate ROBOT TABLE.csv` makes such a file."
)
FROM_LOGS = (
    "**The friction of this arm was not known before**: its values in this report come from these "
    "logs alone. Logs of the motion of `stiction excite ROBOT --sweeps` show friction best; "
    "`stiction diagnose LOG --robot ROBOT` writes it as `model.toml`, which every command takes by "
    "`--friction`."
)


def is_assumed(friction: FrictionParameters) -> bool:
    """Whether friction (of one arm) is that of `generic.toml`."""
    n = friction.stiction.shape[-2]
    if friction.stiction.ndim != 2:
        return False
    return _same(friction, load_friction(GENERIC, n))


def _same(one: FrictionParameters, two: FrictionParameters) -> bool:
    return all(np.array_equal(getattr(one, q), getattr(two, q)) for q in QUANTITIES)


def friction_note(arm: Arm, friction: FrictionParameters | None) -> str:
    """Return the note for the top of a report, one paragraph; empty where friction is known.

    Args:
        arm: the report's arm.
        friction: with which the report's torques were simulated; None where it was fitted to logs.
    """
    if friction is not None:
        # a file that states damping or rotors alone leaves dry friction assumed
        partly = from_file(arm) and not arm.stated.dry and _same(friction, own_friction(arm))
        return ASSUMED if is_assumed(friction) or partly else ""
    return FROM_LOGS if friction_path(arm.registered_name) == GENERIC else ""
