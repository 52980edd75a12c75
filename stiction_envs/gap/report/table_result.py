"""A diagnosis of torque tables, and what only its report has."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stiction_envs.friction.assumed import friction_note
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.plain_mjcf import plain_mjcf
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.tables.extended import extended_friction
from stiction_envs.gap.tables.found import TableDiagnosis
from stiction_envs.reporting.markdown import sentence
from stiction_envs.robots import Arm


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TableResult(DiagnosisResult):
    """What a simulation gets wrong about torque tables."""

    data = "torque tables"
    diagnosis: TableDiagnosis
    """With errors per joint."""
    arm: Arm
    friction: FrictionParameters
    """Nominal."""

    @property
    def note(self) -> str:
        """A note at the top of the report, where friction is assumed."""
        return friction_note(self.arm, self.friction)

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

    @cached_property
    def extension(self) -> Extension:
        """The arm with its causes."""
        friction, changed, missing = extended_friction(
            self.arm, self.friction, self.diagnosis.causes
        )
        found = {k: f"stiction diagnose: {v} in torque tables" for k, v in changed.items()}
        sources = dict.fromkeys(QUANTITIES, f"nominal friction: {self.nominal_name}") | found
        arm = self.arm
        return Extension(
            xml=plain_mjcf(build(arm, friction), friction_name="a diagnosis of torque tables"),
            friction=friction,
            sources=sources,
            nominal=Nominal(friction=friction, robot=arm.name, payload=arm.payload, tilt=arm.tilt),
            missing=missing,
            friction_missing=missing,
            left_out=np.zeros((0, arm.n)),
        )
