"""A diagnosis of joint logs, and the files that are written of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.friction.assumed import friction_note
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.series import Series, log_series
from stiction_envs.gap.validation.check import Check, describe
from stiction_envs.gap.validation.forward import ForwardValidation, validate_forward
from stiction_envs.gap.validation.left_out_motion import LeftOutMotion, leave_out_motions
from stiction_envs.reporting.json_text import plain
from stiction_envs.reporting.markdown import joints, short


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogDiagnosis(DiagnosisResult):
    """What a simulation gets wrong about joint logs."""

    template = "logs.md.j2"
    data = "logs"
    diagnosis: Diagnosis
    """With its signals and fits."""
    torque: str
    """Side of the gear on which it was measured, "motor" or "link"."""
    check: Check | None = None
    """Test of the model on logs that took no part; None without such logs."""

    @property
    def nominal_rms(self) -> NDArray[np.float64]:
        """(n,) held-out residual of the nominal model [N·m]."""
        return self.diagnosis.nominal_rms

    @property
    def extended_rms(self) -> NDArray[np.float64]:
        """(n,) held-out residual of the extended model [N·m]."""
        return self.diagnosis.extended_rms

    @property
    def sentences(self) -> str:
        """The verdict in two sentences."""
        d = self.diagnosis
        before, after = d.nominal_rms, d.extended_rms
        if d.causes:
            means = f"{short(before.mean())} to {short(after.mean())} N·m in the mean of the joints"
            return self.headline(f", from {means}")
        if d.links is not None and self.verdict == "explained":
            return (
                "Small errors of all links explain what the simulation gets wrong, from "
                f"{short(before.mean())} to {short(after.mean())} N·m in the mean of the joints; "
                "no cause stands out of them."
            )
        close = d.settings.verdict.close
        above = [j + 1 for j in range(d.data.n) if before[j] > close * d.noise[j]]
        which = f"{joints(above)} above {close:g} times it" if above else "no joint far above it"
        return (
            f"{self.headline()} Held-out residuals of the {self.nominal_name} model are "
            f"{short(before.min())} to {short(before.max())} N·m, noise floors "
            f"{short(d.noise.min())} to {short(d.noise.max())} N·m, {which}."
        )

    @property
    def summary(self) -> str:
        """The verdict in two sentences, and that of the check logs."""
        text = self.sentences
        return text if self.check is None else f"{text} {describe(self.check)}"

    @property
    def note(self) -> str:
        """A note at the top of the report, where friction is assumed."""
        return friction_note(self.diagnosis.data.arm, self.diagnosis.baseline.friction)

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        return extend(self.diagnosis.base, model_of(self.diagnosis))

    @cached_property
    def forward(self) -> ForwardValidation | str:
        """Both models driven by the measured torques, or the reason why not."""
        return validate_forward(self.diagnosis, threads=self.threads)

    @cached_property
    def left_out_motion(self) -> LeftOutMotion | None:
        """Errors on each log under the fit to the others; None for a single one."""
        return leave_out_motions(self.diagnosis)

    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json``; validates the model forward, which takes some seconds."""
        answer = self.diagnosis.to_json()
        if isinstance(self.forward, ForwardValidation):
            answer["forward"] = self.forward.to_json()
        if self.check is not None:
            answer["check"] = self.check.to_json()
        if self.left_out_motion is not None:
            answer["left_out_motion"] = self.left_out_motion.to_json()
        return dict(plain(answer))

    def validate(self, say: Callable[[str, float], None]) -> None:
        """Simulate both models."""
        say("forward validation", 0.0)
        _ = self.forward

    def page(self, plots: Path) -> dict[str, object]:
        """Draw the report's pictures into a folder; return the variables of its template."""
        from stiction_envs.gap.report.pages import log_page

        return log_page(
            self.diagnosis,
            plots,
            headline=self.sentences,
            forward=self.forward,
            check=self.check,
            left_out=self.left_out_motion,
        )

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return log_series(self.diagnosis, self.summary)

    def rows(self) -> list[tuple[str, str]]:
        """Return seed, side of the torque, and nominal model."""
        seed, side = str(self.provenance["seed"]), f"{self.torque} side"
        return [("seed", seed), ("torque", side), *super().rows()]
