"""A diagnosis of joint logs, and what only its report has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stiction_envs.friction.from_file import friction_note
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.links import LinkErrors
from stiction_envs.gap.report.figures import draw_cause
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.series import Series, log_series
from stiction_envs.gap.validation.check import Check
from stiction_envs.gap.validation.forward import (
    REPLAY,
    SECONDS,
    ForwardValidation,
    validate_forward,
)
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.json_text import plain
from stiction_envs.reporting.markdown import listed, number, percent, short, table_text

FAR = 3.0
"""Prior standard deviations beyond which an error of a link is no tolerance [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogDiagnosis(DiagnosisResult):
    """Diagnosis of joint logs."""

    data = "logs"
    diagnosis: Diagnosis
    """With its signals and fits."""
    torque: str
    """Side of the gear on which it was measured, "motor" or "link"."""
    check: Check | None = None
    """Test of the model on logs that took no part; None without such logs."""

    @property
    def errors(self) -> Errors:
        """Held-out residual, and that of the check logs [N·m]."""
        d, c, more = self.diagnosis, self.check, {}
        some = d.data.measured
        if c is not None:
            more = {"check, nominal": c.nominal_rms[some], "check, extended": c.extended_rms[some]}
        return Errors(
            what="Root mean square of measured less modelled torque, on rows with which the model "
            "was neither chosen nor fitted",
            unit="N·m",
            joints=tuple(int(j) + 1 for j in np.flatnonzero(some)),
            nominal=d.nominal_rms[some],
            extended=d.extended_rms[some],
            noise=d.noise[some],
            more=more,
        )

    @property
    def headline(self) -> str:
        """The verdict in sentences, and which links are too far off."""
        d = self.diagnosis
        findings = [x[0].upper() + x[1:] + ("" if x[-1] in ".?" else ".") for x in d.findings]
        links = "" if d.set_up else far_links(d.links)
        return " ".join(x for x in (*findings, super().headline, links) if x)

    @property
    def checked(self) -> str:
        """See `DiagnosisResult.checked`."""
        return "" if self.check is None else str(self.check)

    @property
    def note(self) -> str:
        """See `DiagnosisResult.note`."""
        return friction_note(self.diagnosis.data.arm, self.diagnosis.baseline.friction)

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        return extend(self.diagnosis.base, model_of(self.diagnosis))

    @cached_property
    def forward(self) -> ForwardValidation | str:
        """Both models driven by the measured torques, or the reason why not."""
        return validate_forward(self.diagnosis, threads=self.threads)

    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json``; validates the model forward, which takes some seconds."""
        answer = self.diagnosis.to_json()
        if isinstance(self.forward, ForwardValidation):
            answer["forward"] = self.forward.to_json()
        if self.check is not None:
            answer["check"] = self.check.to_json()
        return dict(plain(answer))

    def drawn(self, cause: NamedCause, plots: Path) -> str:
        """See `DiagnosisResult.drawn`."""
        return draw_cause(self.diagnosis, cause, plots)

    def details(self, plots: Path) -> dict[str, object]:
        """Return links, forward validation, what does not transfer, and what was corrected."""
        d, check = self.diagnosis, self.check
        out: dict[str, object] = {
            "record": d.what_to_record or ("nothing: every cause could be seen",),
            "forward": forward_text(self.forward),
        }
        about = [f"torques of the {self.torque} side of the gears", *_about(d.logs)]
        notes = dict.fromkeys(d.notes)
        if check is not None:
            about += _about(check.logs, " (check)")
            notes |= dict.fromkeys(check.notes)
            out["elsewhere"] = [
                f"**{x.name} does not transfer** to the check logs: joint {j} is off by "
                f"{short(x.without[j - 1])} N·m without it, {short(check.extended_rms[j - 1])} N·m "
                "with it"
                for x in check.transfers
                if x.fails
                for j in x.harmed
            ]
        out["notes"] = [*about, *notes]
        if d.links is not None:
            usual = "an earlier diagnosis left in doubt"
            if d.baseline.links is None:
                usual = "CAD is usually off by (mass 10 %, centre 15 mm, shape 20 %)"
            near = f"All are within {FAR:g} standard deviations of what {usual}."
            out["links"] = link_table(d.links)
            out["about_links"] = far_links(d.links) or near
        return out

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return log_series(self.diagnosis)


def far_links(links: LinkErrors | None) -> str:
    """Return how far the links are off that are beyond any tolerance, a sentence; or nothing."""
    if links is None or not (links.distance > FAR).any():
        return ""
    each = [
        f"link {k} is off by {short(far, 2)} prior standard deviations"
        for k, far in enumerate(links.distance, start=1)
        if far > FAR
    ]
    return f"No tolerance: {listed(each)}; a body is wrong there, or what is named is not all."


def link_table(links: LinkErrors) -> str:
    """Return mass and centre that each link has more than the model."""
    each = zip(links.mass, links.centre, links.distance, strict=True)
    rows = [
        [f"link {k}", f"{short(mass[0])} ± {short(mass[1])}"]
        + [f"{number(1e3 * x)} ± {1e3 * width:.1f}" for x, width in centre]
        + [short(far, 2)]
        for k, (mass, centre, far) in enumerate(each, start=1)
    ]
    header = ["", "mass [kg]", "centre x [mm]", "y [mm]", "z [mm]", "off by [prior deviations]"]
    return table_text(header, rows)


def forward_text(forward: ForwardValidation | str) -> str:
    """Return how both models fare in simulation, as Markdown."""
    if isinstance(forward, str):
        return f"None: {forward}."
    columns = [*forward.replay.values(), *forward.tracking.values()]
    rows = [
        [f"joint {j}", *(short(x) for x in values)]
        for j, values in enumerate(zip(*columns, strict=True), start=1)
    ]
    means = [f"**{percent(-x.mean(), 0)}**" for x in forward.gains]
    rows.append(["mean", "", means[0], "", means[1]])
    text = (
        f"Both models run in stock MuJoCo on {forward.windows} windows of {SECONDS:g} s that "
        "were not fitted, each from the measured state. Replay: how far the arm strays in "
        f"{REPLAY:g} s under the measured torques alone. Tracking: what a servo must add to keep "
        "it on the measured motion."
    )
    if forward.unstable:
        text += f" What is unstable does not count: {forward.unstable}."
    header = ["", "replay, nominal [rad]", "extended", "tracking, nominal [N·m]", "extended"]
    return f"{text}\n\n{table_text(header, rows)}"


def _about(logs: Sequence[JointLog], kind: str = "") -> list[str]:
    """Return each log's content, its corrections, and its defects that were not corrected."""
    out = []
    for log in logs:
        name = f"`{Path(log.source).name}`"
        what = "poses at rest" if log.static else f"rows, {log.t[-1] - log.t[0]:.1f} s"
        out.append(f"{name}{kind}: {len(log.t)} {what}")
        out += [f"{name}: {c.text}" for c in log.corrections]
        out += [f"{name}: not corrected: {text}" for text in log.warnings]
    return out
