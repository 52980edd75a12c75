"""A diagnosis of servo logs, and what only its report has."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.series import Series, servo_series
from stiction_envs.gap.servo.diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.model import servo_extension
from stiction_envs.gap.servo.parameters import FAR, PARAMETERS
from stiction_envs.reporting.markdown import joints, short, table_text
from stiction_envs.robots import Arm

_BOTH_SIDES = "poses on both sides of where gravity's torque on the joint is zero"
_FREQUENCIES = "commands of several frequencies, up to where the joint hardly follows"
WOULD = {
    "payload": "a log with another, known mass at the tip",
    "link_parameters": "a log with a known mass at the tip",
    "encoder_offset": _BOTH_SIDES,
    "servo_stiffness": "its stiffness, from the data sheet, as --servo-stiffness",
    "torque_offset": _BOTH_SIDES,
    "coulomb_friction": "slow motion through several poses, both ways",
    "damping": _FREQUENCIES,
    "delay": _FREQUENCIES,
    "armature": _FREQUENCIES,
    "torque_limit": "the same fast motion with and without a known mass",
    "external_contact": "the same motion with nothing within reach",
}
"""Measurements that would tell a cause from another."""
ALWAYS = (
    "the robot's masses set the scale of all torques: were they 10 % larger, so would be "
    "stiffness, friction and damping",
    "a weight on the tip, a joint's zero that is off, and a softer servo sag alike",
)
"""What positions alone cannot tell."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ServoResult(DiagnosisResult):
    """What a simulation gets wrong about logs of commanded and measured positions."""

    data = "servo logs"
    diagnosis: ServoDiagnosis
    """With simulated angles."""
    arm: Arm
    before: Nominal
    """What earlier diagnoses found at its flange."""

    @property
    def errors(self) -> Errors:
        """Held-out error of the angle, and that of the check logs [mrad]."""
        d, c, more = self.diagnosis, self.diagnosis.check, {}
        if c is not None:
            more = {"check, nominal": 1e3 * c.nominal_rms, "check, extended": 1e3 * c.extended_rms}
        return Errors(
            what="Root mean square of measured less simulated angle, the whole arm simulated from "
            "its commands alone, each part of the time under the fit of the others",
            unit="mrad",
            joints=tuple(range(1, len(d.noise) + 1)),
            nominal=1e3 * d.nominal_rms,
            extended=1e3 * d.extended_rms,
            noise=1e3 * d.noise,
            more=more,
        )

    @property
    def checked(self) -> str:
        """See `DiagnosisResult.checked`."""
        c = self.diagnosis.check
        if c is None:
            return ""
        before, after = 1e3 * c.nominal_rms.mean(), 1e3 * c.extended_rms.mean()
        worse = f"; worse: {joints(list(c.worse_joints))}" if c.worse_joints else ""
        return (
            f"On logs that took no part the model {c.verdict}: {short(before)} to "
            f"{short(after)} mrad{worse}."
        )

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        return servo_extension(self.diagnosis, self.arm, self.before)

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return servo_series(self.diagnosis, self.arm)

    def tells_apart(self, cause: str, other: str) -> str:
        """See `DiagnosisResult.tells_apart`."""
        return WOULD.get(other, "a motion in which the two act differently")

    def details(self, plots: Path) -> dict[str, object]:
        """Return the servos, and what was assumed."""
        header = ["", *(f"joint {j + 1}" for j in range(self.arm.n))]
        rows = [
            [f"{name.replace('_', ' ')} [{p.unit}]"]
            + ["–" if x == p.absent or x >= FAR else short(x) for x in column]
            for (name, p), column in zip(
                PARAMETERS.items(), self.diagnosis.parameters.T, strict=True
            )
        ]
        return {"servos": table_text(header, rows), "notes": [*self.diagnosis.notes, *ALWAYS]}
