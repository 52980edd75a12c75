"""A diagnosis of torque tables, and what only its report has."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from stiction_envs.friction.from_file import friction_note
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.tables.diagnosis import TableDiagnosis
from stiction_envs.gap.tables.extended import table_extension
from stiction_envs.reporting.markdown import sentence
from stiction_envs.robots import Arm


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TableResult(DiagnosisResult):
    """Diagnosis of torque tables."""

    data = "torque tables"
    diagnosis: TableDiagnosis
    """With errors per joint."""
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
        return table_extension(self.arm, self.friction, self.nominal_name, self.causes)
