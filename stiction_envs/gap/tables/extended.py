"""Causes that torque tables show, put into the arm's friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction_envs.experiments.poses import find_poses
from stiction_envs.friction.export import plain_mjcf
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.steady import steady
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.tables.causes import cause_named
from stiction_envs.reporting.markdown import joints
from stiction_envs.robots import Arm


def table_extension(
    arm: Arm, friction: FrictionParameters, nominal_name: str, causes: Sequence[NamedCause]
) -> Extension:
    """Return the arm with the causes of a diagnosis; ``friction`` is nominal."""
    more, changed, lacks = extended_friction(arm, friction, causes)
    bounded: list[str] = []
    more = steady(more, arm, say=lambda j, text: bounded.append(f"joint {j + 1}: {text}"))
    missing = (*lacks, *bounded)
    found = {k: f"stiction diagnose: {v} in torque tables" for k, v in changed.items()}
    return Extension(
        xml=plain_mjcf(build(arm, more), friction_name="a diagnosis of torque tables"),
        friction=more,
        sources=dict.fromkeys(QUANTITIES, f"nominal friction: {nominal_name}") | found,
        nominal=Nominal(friction=more, robot=arm.name, payload=arm.payload, tilt=arm.tilt),
        missing=missing,
        friction_missing=missing,
        left_out=np.zeros((0, arm.n)),
    )


def extended_friction(
    arm: Arm, friction: FrictionParameters, causes: Sequence[NamedCause]
) -> tuple[FrictionParameters, dict[str, str], tuple[str, ...]]:
    """Put causes into friction.

    Args:
        arm: the arm.
        friction: nominal, of one arm.
        causes: causes of a diagnosis with it.

    Returns:
        Friction, the causes that changed each changed quantity, and the causes that it lacks.
    """
    poses = find_poses(arm)
    changed: dict[str, str] = {}
    missing = []
    for found in causes:
        (own,) = found.parameters.values()
        values = {k: float(np.mean(p.value)) for k, p in own.items()}
        cause = cause_named(found.name)
        for joint in found.joints:
            more = cause.in_friction(friction, poses, joint - 1, values)
            if isinstance(more, str):
                missing.append(f"{cause.name} of {joints(found.joints)}: {more}")
                break
            for name, value in more.items():
                by = [*filter(None, changed.get(name, "").split(", ")), cause.name]
                changed[name] = ", ".join(dict.fromkeys(by))
                array = np.array(getattr(friction, name))
                array[joint - 1] = value
                friction = friction.replace(**{name: array})
    return friction, changed, tuple(missing)
