"""Causes that torque tables show, put into the arm's friction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.calibrate import with_levels
from stiction_envs.experiments.sje.poses import Poses, find_poses
from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.sentences import TableCause
from stiction_envs.reporting.markdown import joints
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
FACTORS = {"rotor_inertia": "rotor_inertia", "presliding": "bristle_stiffness"}
"""Quantity that a cause's factor multiplies."""
LEAST = 1e-6
"""Stiction of a direction that is left none [N·m]: the least that our friction allows."""
NOT_FRICTION = {
    "low_pass": "a low-pass of {cutoff_hz:.4g} Hz on the commanded torque is the interface's",
    "base_drift": "friction of another day",
    "corrupted_cell": "a bad reading",
}
"""Causes that are none of the arm, and why."""


def extended_friction(
    arm: Arm, friction: FrictionParameters, causes: tuple[TableCause, ...]
) -> tuple[FrictionParameters, dict[str, str], tuple[str, ...]]:
    """Put causes into friction.

    Args:
        arm: the arm.
        friction: nominal, of one arm.
        causes: of a diagnosis with it.

    Returns:
        Friction, the cause by which each changed quantity was changed, and what it leaves out.
    """
    poses = find_poses(arm)
    changed: dict[str, str] = {}
    missing = []
    for cause in causes:
        values = {k: p.value for k, p in cause.parameters.items()}
        if cause.name in NOT_FRICTION:
            why = NOT_FRICTION[cause.name].format(**{k.split()[0]: v for k, v in values.items()})
            missing.append(f"{cause.name} of {joints(cause.joints)}: {why}")
            continue
        for joint in cause.joints:
            new = _changed(friction, poses, joint - 1, cause.name, values)
            for name, value in new.items():
                changed[name] = ", ".join(dict.fromkeys([changed.get(name, ""), cause.name]))
                changed[name] = changed[name].removeprefix(", ")
                own = np.array(getattr(friction, name))
                own[joint - 1] = value
                friction = friction.replace(**{name: own})
    return friction, changed, tuple(missing)


def _changed(
    friction: FrictionParameters, poses: Poses, j: int, name: str, values: Mapping[str, float]
) -> dict[str, Array | float]:
    """Return the quantities of one joint (from 0) that a cause changes."""
    if name in FACTORS:
        quantity = FACTORS[name]
        return {quantity: getattr(friction, quantity)[j] * _only(values, "factor")}
    if name == "torque_offset":
        return {"offset": friction.offset[j] + _only(values, "offset_nm")}
    if name == "gravity_error":
        return {"gravity_error": friction.gravity_error[j] + _only(values, "share_of_gravity")}
    if name == "direction_asymmetry":
        more = _only(values, "asymmetry_nm")
        instead = values.get("offset_nm", 0.0)
        return {
            "stiction": np.maximum(friction.stiction[j] + more * np.array([1, -1]), LEAST),
            "offset": friction.offset[j] + instead,
        }
    factors = np.array([_of_pose(values, load) for load in LOADS])
    if factors[0] == factors[1]:
        return {
            "stiction": friction.stiction[j] * factors[0],
            "load_coefficient": friction.load_coefficient[j] * factors[0],
        }
    both = [friction.stiction_at(poses.load[:, k]).mean(axis=1) for k in range(len(LOADS))]
    level = np.stack(both, axis=1)
    level[j] *= factors
    offset = friction.offset[:, None] + friction.gravity_error[:, None] * poses.signed
    line = with_levels(friction, poses, level, offset)
    names = ("stiction", "load_coefficient", "load_low", "load_high")
    return {k: getattr(line, k)[j] for k in names}


def _only(values: Mapping[str, float], key: str) -> float:
    """Return a parameter, whatever poses its name says it was found in."""
    return next(v for k, v in values.items() if k.split()[0] == key)


def _of_pose(values: Mapping[str, float], load: str) -> float:
    """Return the factor on the friction of a pose; 1 where none was found."""
    scopes = (f"factor {load}", "factor", "factor both poses")
    return float(np.prod([values[k] for k in scopes if k in values]))
