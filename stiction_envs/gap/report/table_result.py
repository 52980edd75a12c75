"""A diagnosis of torque tables, what only its report has, and the arm with its causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stiction_envs.experiments.poses import find_poses
from stiction_envs.friction.from_file import friction_note
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.plain_mjcf import plain_mjcf
from stiction_envs.friction.steady import steady
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.tables.causes import cause_named
from stiction_envs.gap.tables.diagnosis import TableDiagnosis
from stiction_envs.reporting.markdown import joints, sentence
from stiction_envs.robots import Arm


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TableResult(DiagnosisResult):
    """What a simulation gets wrong about torque tables."""

    data = "torque tables"
    diagnosis: TableDiagnosis
    arm: Arm
    friction: FrictionParameters
    """Nominal."""

    @property
    def errors(self) -> Errors:
        """Held-out error over the joint's friction [%]."""
        d = self.diagnosis
        return Errors(
            what="Mean of |measured less simulated torque| over the joint's friction, each "
            "frequency and scale predicted from the others",
            unit="%",
            joints=d.joints,
            nominal=d.nominal,
            extended=d.extended,
            noise=d.noise_floor,
        )

    @property
    def checked(self) -> str:
        """Why the tables are not, or not fully, explained."""
        return sentence(self.diagnosis.reason) if self.diagnosis.reason else ""

    @property
    def note(self) -> str:
        """See `DiagnosisResult.note`."""
        return friction_note(self.arm, self.friction)

    @cached_property
    def extension(self) -> Extension:
        """The arm with its causes."""
        arm = self.arm
        friction, changed, missing = extended_friction(arm, self.friction, self.causes)
        friction = steady(
            friction, arm, say=lambda j, text: missing.append(f"joint {j + 1}: {text}")
        )
        sources = dict.fromkeys(QUANTITIES, f"nominal friction: {self.nominal_name}")
        sources |= {k: f"stiction diagnose: {v} in torque tables" for k, v in changed.items()}
        return Extension(
            xml=plain_mjcf(build(arm, friction), friction_name="a diagnosis of torque tables"),
            friction=friction,
            sources=sources,
            nominal=Nominal(friction=friction, robot=arm.name, payload=arm.payload, tilt=arm.tilt),
            missing=tuple(missing),
            friction_missing=tuple(missing),
            left_out=np.zeros((0, arm.n)),
        )


def extended_friction(
    arm: Arm, friction: FrictionParameters, causes: Sequence[NamedCause]
) -> tuple[FrictionParameters, dict[str, str], list[str]]:
    """Put causes of a diagnosis into the nominal friction of an arm.

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
    return friction, changed, missing
