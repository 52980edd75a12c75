"""Results of each kind of data: joint logs, servo logs and torque tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from stiction_envs.experiments.poses import find_poses
from stiction_envs.friction.export import plain_mjcf
from stiction_envs.friction.from_file import friction_note
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.steady import steady
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.extended_model import Extension, extend
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.links import LinkErrors
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.report.figures import draw_cause
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.result import DiagnosisResult
from stiction_envs.gap.report.series import Series, log_series, servo_series
from stiction_envs.gap.servo.causes import servo_cause
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.servo_mjcf import servo_extension
from stiction_envs.gap.servo.servo_parameters import FAR, PARAMETERS
from stiction_envs.gap.tables.causes import cause_named
from stiction_envs.gap.tables.table_diagnosis import TableDiagnosis
from stiction_envs.gap.validation.check import Check
from stiction_envs.gap.validation.forward import ForwardValidation, validate_forward
from stiction_envs.measured.logs.robot_log import JointLog
from stiction_envs.reporting.json_text import plain
from stiction_envs.reporting.markdown import joints, listed, number, sentence, short, table_text
from stiction_envs.robots import Arm

NO_TOLERANCE = 3.0
"""Prior standard deviations beyond which an error of a link is no tolerance [-]; assumed."""
ALWAYS = (
    "the robot's masses set the scale of all torques: were they 10 % larger, so would be "
    "stiffness, friction and damping",
    "a weight on the tip, a joint's zero that is off, and a softer servo sag alike",
)
"""Properties that positions alone cannot show."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogDiagnosis(DiagnosisResult):
    """Errors of a simulation, found in joint logs."""

    data = "logs"
    diagnosis: Diagnosis
    check: Check | None = None
    """Test of the model on logs that took no part; None without such logs."""

    @property
    def errors(self) -> Errors:
        """Held-out residual, and that of the check logs [N·m]."""
        d, c, some = self.diagnosis, self.check, self.diagnosis.data.measured
        return Errors(
            what="Root mean square of measured less modelled torque, on rows with which the model "
            "was neither chosen nor fitted",
            unit="N·m",
            joints=tuple(int(j) + 1 for j in np.flatnonzero(some)),
            nominal=d.nominal_rms[some],
            extended=d.extended_rms[some],
            noise=d.noise[some],
            check=None if c is None else (c.nominal_rms[some], c.extended_rms[some]),
        )

    @property
    def headline(self) -> str:
        """The verdict in sentences, and which links are too far off."""
        d = self.diagnosis
        findings = [sentence(x).replace("?.", "?") for x in d.data.recording.findings]
        links = "" if d.data.recording.set_up else far_links(d.links)
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

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return log_series(self.diagnosis)

    def drawn(self, cause: NamedCause, plots: Path) -> str:
        """See `DiagnosisResult.drawn`."""
        return draw_cause(self.diagnosis, cause, plots)

    def details(self) -> dict[str, object]:
        """Return links, forward validation, and what was corrected."""
        d, check, forward = self.diagnosis, self.check, self.forward
        notes = dict.fromkeys(d.notes)
        side = d.data.recording.torque
        about = [f"torques of the {side} side of the gears", *_about(d.logs)]
        out: dict[str, object] = {
            "record": d.what_to_record or ("nothing: every cause could be seen",),
            "forward": f"None: {forward}." if isinstance(forward, str) else forward.text(),
        }
        if check is not None:
            about += _about(check.logs, " (check)")
            notes |= dict.fromkeys(check.notes)
        if d.links is not None:
            usual = "an earlier diagnosis left in doubt"
            if d.baseline.links is None:
                usual = "CAD is usually off by (mass 10 %, centre 15 mm, shape 20 %)"
            near = f"All are within {NO_TOLERANCE:g} standard deviations of what {usual}."
            out |= {"links": link_table(d.links), "about_links": far_links(d.links) or near}
        return out | {"notes": [*about, *notes]}


def far_links(links: LinkErrors | None) -> str:
    """Return how far the links are off that are beyond any tolerance, a sentence; or nothing."""
    each = [
        f"link {k} is off by {short(far, 2)} prior standard deviations"
        for k, far in enumerate([] if links is None else links.distance, start=1)
        if far > NO_TOLERANCE
    ]
    if not each:
        return ""
    return f"No tolerance: {listed(each)}; a body is wrong there, or what is named is not all."


def link_table(links: LinkErrors) -> str:
    """Return mass and centre that each link has more than the model."""
    rows = [
        [f"link {k}", f"{short(mass[0])} ± {short(mass[1])}"]
        + [f"{number(1e3 * x)} ± {1e3 * width:.1f}" for x, width in centre]
        + [short(far, 2)]
        for k, (mass, centre, far) in enumerate(
            zip(links.mass, links.centre, links.distance, strict=True), start=1
        )
    ]
    header = ["", "mass [kg]", "centre x [mm]", "y [mm]", "z [mm]", "off by [prior deviations]"]
    return table_text(header, rows)


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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ServoResult(DiagnosisResult):
    """Errors of a simulation, found in logs of commanded and measured positions."""

    data = "servo logs"
    diagnosis: ServoDiagnosis
    arm: Arm
    before: Nominal
    """Nominal model, with the payload that earlier diagnoses found."""

    @property
    def errors(self) -> Errors:
        """Held-out error of the angle, and that of the check logs [mrad]."""
        d, c = self.diagnosis, self.diagnosis.check
        return Errors(
            what="Root mean square of measured less simulated angle, the whole arm simulated from "
            "its commands alone, each part of the time under the fit of the others",
            unit="mrad",
            joints=tuple(range(1, len(d.noise) + 1)),
            nominal=1e3 * d.nominal_rms,
            extended=1e3 * d.extended_rms,
            noise=1e3 * d.noise,
            check=None if c is None else (1e3 * c.nominal_rms, 1e3 * c.extended_rms),
        )

    @property
    def checked(self) -> str:
        """See `DiagnosisResult.checked`."""
        c = self.diagnosis.check
        if c is None:
            return ""
        before, after = (short(1e3 * x.mean()) for x in (c.nominal_rms, c.extended_rms))
        worse = f"; worse: {joints(list(c.worse_joints))}" if c.worse_joints else ""
        return f"On logs that took no part the model {c.verdict}: {before} to {after} mrad{worse}."

    @cached_property
    def extension(self) -> Extension:
        """The model with its causes."""
        return servo_extension(self.diagnosis, self.arm, self.before)

    def series(self) -> Series:
        """See `DiagnosisResult.series`."""
        return servo_series(self.diagnosis)

    def tells_apart(self, cause: NamedCause, other: str) -> str:
        """See `DiagnosisResult.tells_apart`."""
        return servo_cause(other).servo.tells_apart

    def details(self) -> dict[str, object]:
        """Return the servos, and what was assumed."""
        d = self.diagnosis
        rows = [
            [f"{name.replace('_', ' ')} [{p.unit}]"]
            + ["–" if x == p.absent or x >= FAR else short(x) for x in column]
            for (name, p), column in zip(PARAMETERS.items(), d.parameters.T, strict=True)
        ]
        header = ["", *(f"joint {j + 1}" for j in range(self.arm.n))]
        return {"servos": table_text(header, rows), "notes": [*d.notes, *ALWAYS]}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TableResult(DiagnosisResult):
    """Errors of a simulation, found in torque tables."""

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

        def say(joint: int, text: str) -> None:
            missing.append(f"joint {joint + 1}: {text}")

        friction = steady(friction, arm, say=say)
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
    """Put causes of torque tables into the nominal friction of an arm.

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
