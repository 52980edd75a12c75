"""A diagnosis of servo logs, and the files that are written of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.model_file import Nominal, changed_arm
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.series import Series, servo_series
from stiction_envs.gap.servo.arm import friction_of, reaching
from stiction_envs.gap.servo.diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.model import said_of, servo_mjcf, servo_toml
from stiction_envs.reporting.markdown import joints, short
from stiction_envs.robots import Arm


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoExtension(Extension):
    """A model with its servos."""

    servo: str
    """The table ``[servo]``."""

    def toml(self, *, meta: dict[str, str], provenance: dict[str, str]) -> str:
        """See `Extension.toml`."""
        return super().toml(meta=meta, provenance=provenance) + self.servo


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ServoResult(DiagnosisResult):
    """What a simulation gets wrong about logs of commanded and measured positions."""

    template = "servo.md.j2"
    data = "servo logs"
    diagnosis: ServoDiagnosis
    """With simulated angles."""
    arm: Arm
    before: Nominal
    """What earlier diagnoses found at its flange."""

    @property
    def summary(self) -> str:
        """The verdict in sentences, and that of the check logs."""
        d = self.diagnosis
        before, after = 1e3 * d.nominal_rms.mean(), 1e3 * d.extended_rms.mean()
        amount = f", from {short(before)} to {short(after)} mrad in the mean of the joints"
        text = self.headline(amount if d.causes else "")
        if d.check is None:
            return text
        c = d.check
        before, after = 1e3 * c.nominal_rms.mean(), 1e3 * c.extended_rms.mean()
        worse = f"; worse: {joints(list(c.worse_joints))}" if c.worse_joints else ""
        return (
            f"{text} On logs that took no part the model {c.verdict}: {short(before)} to "
            f"{short(after)} mrad{worse}."
        )

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        d, parts = self.diagnosis, self.before.parts
        if d.payload is not None:
            level = 1 + max((p.level for p in parts), default=0)
            parts = (*parts, d.payload.part(level))
        arm = reaching(changed_arm(self.arm, parts), d.logs)
        xml, missing = servo_mjcf(arm, d.parameters, d.load)
        friction = friction_of(arm, d.parameters, d.load)
        found = said_of([c.name for c in d.causes])
        sources = dict.fromkeys(QUANTITIES, "assumed: no servo log shows it") | found
        return ServoExtension(
            xml=xml,
            friction=friction,
            sources=sources,
            nominal=Nominal(
                friction=friction,
                parts=parts,
                robot=arm.name,
                payload=arm.payload,
                tilt=arm.tilt,
            ),
            missing=missing,
            friction_missing=(),
            left_out=np.zeros((0, arm.n)),
            servo=servo_toml(d.parameters),
        )

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return servo_series(self.diagnosis, self.arm, self.summary)

    def page(self, plots: Path) -> dict[str, object]:
        """Draw the report's pictures into a folder; return the variables of its template."""
        from stiction_envs.gap.report.servo_page import servo_page

        return servo_page(self.diagnosis, plots, headline=self.summary)
