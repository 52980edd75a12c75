"""Friction parameters from a robot's MJCF or URDF."""

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.friction.parameters import (
    GENERIC,
    QUANTITIES,
    FrictionParameters,
    friction_path,
    load_friction,
)
from stiction_envs.friction.steady import steady
from stiction_envs.robots import Arm
from stiction_envs.robots.stated import DAMPING, DRY, ROTORS, SPRINGS

NO_STRIBECK = 0.05
"""Stribeck velocity of friction that is the same at rest and in motion [rad/s]: no effect."""


def own_friction(arm: Arm) -> FrictionParameters:
    """Return the friction of an arm: its TOML's, else its file's, the rest from `generic.toml`.

    An arm of a file without dry friction gets that of `generic.toml`, without damping or rotors
    likewise: an arm that slides freely shows no stiction.
    """
    out = shipped_friction(arm)
    if not from_file(arm):
        return out
    s, file = arm.stated, file_friction(arm)
    names = []
    if s.dry:
        names += ["stiction", "coulomb_ratio", "stribeck_velocity", "bristle_stiffness"]
        names += ["ripple_amplitude", "ripple_periods"]
    names += ["viscous"] if s.damping.any() else []
    return steady(out.replace(**{k: getattr(file, k) for k in names}), arm)


def shipped_friction(arm: Arm) -> FrictionParameters:
    """Return the friction of an arm's TOML, else of `generic.toml` with the rotors of its file."""
    out = load_friction(arm.registered_name, arm.n)
    if not (from_file(arm) and arm.stated.armature.any()):
        return out
    return steady(out.replace(rotor_inertia=arm.stated.armature.copy()), arm)


def from_file(arm: Arm) -> bool:
    """Return whether numbers of `own_friction` are those of the robot's MJCF or URDF."""
    s = arm.stated
    return friction_path(arm.registered_name) == GENERIC and (s.friction or bool(s.armature.any()))


def file_friction(arm: Arm) -> FrictionParameters:
    """Return the friction and rotors that an arm's file states, and nothing else.

    A joint without stated dry friction has the least that `FrictionParameters` allow. frictionloss
    has no bristle: its stiffness is that of a presliding distance as in `generic.toml`.
    """
    s, generic = arm.stated, load_friction(GENERIC, arm.n)
    stiction = np.maximum(s.stiction, QUANTITIES["stiction"].low)
    distance = generic.stiction.mean(axis=1) / generic.bristle_stiffness
    bristle = np.where(s.bristle > 0, s.bristle, stiction / distance)
    values = {k: np.full(arm.n, q.default) for k, q in QUANTITIES.items() if q.default is not None}
    values |= {
        "stiction": _both(stiction),
        "coulomb_ratio": _both(np.where(s.stiction > 0, s.coulomb / stiction, 1.0)),
        "stribeck_velocity": _both(np.where(s.stribeck > 0, s.stribeck, NO_STRIBECK)),
        "viscous": _both(s.damping),
        "bristle_stiffness": np.maximum(bristle, QUANTITIES["bristle_stiffness"].low),
        "rotor_inertia": s.armature.copy(),
    }
    return steady(FrictionParameters(**values), arm)


def _both(values: Array) -> Array:
    """Return (n, 2) values of both directions."""
    return np.stack([values, values], axis=1)


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


def _same(one: FrictionParameters, two: FrictionParameters) -> bool:
    return all(np.array_equal(getattr(one, q), getattr(two, q)) for q in QUANTITIES)


def simulated_note(arm: Arm, friction: FrictionParameters) -> str:
    """Return the top of a report of simulations: `friction_note`, how the robot's file was read."""
    own, used = own_friction(arm), [SPRINGS]
    for kind, name in ((ROTORS, "rotor_inertia"), (DRY, "stiction"), (DAMPING, "viscous")):
        used += [kind] * np.array_equal(getattr(friction, name), getattr(own, name))
    read = (f"{x}." for x in arm.notes(used))
    return " ".join(x for x in (friction_note(arm, friction), *read) if x)


def friction_note(arm: Arm, friction: FrictionParameters | None) -> str:
    """Return the paragraph on assumed friction for the top of a report; empty if friction is known.

    ``friction`` is what the report's torques were simulated with; None if it was fitted to logs.
    """
    if friction is not None:
        # a file that states damping or rotors alone leaves dry friction assumed
        partly = from_file(arm) and not arm.stated.dry and _same(friction, own_friction(arm))
        assumed = _same(friction, load_friction(GENERIC, friction.n))
        return ASSUMED if assumed or partly else ""
    return FROM_LOGS if friction_path(arm.registered_name) == GENERIC else ""
