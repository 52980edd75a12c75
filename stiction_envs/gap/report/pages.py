"""Numbers, tables and pictures of the reports' templates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import cause_named, parameter_units
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.judge.judgement import Estimate, NamedCause
from stiction_envs.gap.links import LinkErrors
from stiction_envs.gap.report.figures import JointPictures, draw_cause
from stiction_envs.gap.report.result import PLOTS, Picture, where
from stiction_envs.gap.report.score_figures import draw_check, draw_forward, draw_summary
from stiction_envs.gap.tables.causes import cause_named as table_cause
from stiction_envs.gap.tables.found import TableDiagnosis
from stiction_envs.gap.validation import check as checks
from stiction_envs.gap.validation.check import Check
from stiction_envs.gap.validation.forward import REPLAY, SECONDS, ForwardValidation
from stiction_envs.gap.validation.left_out_motion import LeftOutMotion
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.markdown import listed, number, percent, short, table_text

Array = NDArray[np.float64]


def section(
    cause: NamedCause,
    parameters: Mapping[str, Mapping[str, Estimate]],
    units: Mapping[str, str],
    what_would: Mapping[str, str],
    picture: Picture | None = None,
) -> dict[str, object]:
    """Return a cause's section of the report.

    ``parameters`` are by joint, ``what_would`` are the measurements that tell it from others.
    """
    rows = [
        [place, f"`{name}` [{units.get(name.split()[0], '–')}]", *_values(e)]
        for place, found in parameters.items()
        for name, e in found.items()
    ]
    header = ["where", "parameter", "value", "95 % interval", ""]
    return {
        "name": cause.name,
        "where": where(cause.joints),
        "evidence": cause.evidence,
        "gain_percent": cause.gain_percent,
        "confused_with": tuple(cause.confused_with),
        "what_would": [f"from {other}: {text}" for other, text in what_would.items()],
        "picture": shown(picture) if picture else "",
        "parameters": table_text(header, rows) if rows else "",
    }


def _values(e: Estimate) -> list[str]:
    """Return value, interval, and whether it is on its bound."""
    bound = "**on its bound**" if e.on_bound else ""
    if isinstance(e.value, int):  # a choice, not a measure
        return [str(e.value), "", bound]
    values, intervals = (e.value, e.ci95) if isinstance(e.value, list) else ([e.value], [e.ci95])
    spans = ", ".join(f"{short(low)} to {short(high)}" for low, high in intervals)
    return [", ".join(short(x) for x in values), spans, bound]


def shown(picture: Picture) -> str:
    """Return a picture and its caption in Markdown."""
    alt = picture.file.removesuffix(".png").replace("_", " ")
    return f"![{alt}]({PLOTS}/{picture.file})\n\n{picture.caption}"


def by_joint(header: Sequence[str], *columns: Array, joints: Sequence[int] = ()) -> str:
    """Return a table of numbers (n,) of each joint; ``joints`` () counts them from 1."""
    rows = zip(joints or range(1, len(columns[0]) + 1), *columns, strict=True)
    cells = [[f"joint {j}", *(short(x) for x in row)] for j, *row in rows]
    return table_text(["joint", *header], cells)


# ---- torque tables -------------------------------------------------------------------------------


def table_page(d: TableDiagnosis, plots: Path, *, headline: str) -> dict[str, object]:
    """Draw the picture of a report of torque tables; return its template's variables."""
    errors = d.nominal, d.extended, d.noise_floor
    pictures = {"summary": ""}
    if np.isfinite(d.nominal).any():
        caption = "Mean error over friction; each frequency and scale predicted from the others."
        label = "held-out error over friction [%]"
        path = plots / "summary.png"
        drawn = draw_summary(*errors, path, label, caption, d.joints)
        pictures["summary"] = shown(drawn)
    return {
        "headline": headline,
        "pictures": pictures,
        "causes": [
            section(
                c,
                {where(c.joints): x for x in c.parameters.values()},
                table_cause(c.name).units,
                c.told_apart_by or {},
            )
            for c in d.causes
        ],
        "errors": by_joint(
            ["nominal [%]", "extended [%]", "noise floor [%]"], *errors, joints=d.joints
        ),
    }


# ---- logs ----------------------------------------------------------------------------------------


def log_page(
    d: Diagnosis,
    plots: Path,
    *,
    headline: str,
    forward: ForwardValidation | str,
    check: Check | None = None,
    left_out: LeftOutMotion | None = None,
) -> dict[str, object]:
    """Draw the pictures of a report of logs into ``plots``; return its template's variables."""
    pictures = _drawn(d, plots, forward, check)
    page: dict[str, object] = {}
    if isinstance(forward, ForwardValidation):
        page["forward_errors"] = _forward_errors(forward)
    if check is not None:
        page["check_verdict"] = checks.describe(check)
        page["check_errors"], page["check_causes"] = _check_errors(check, d), _check_causes(check)
    if left_out is not None:
        page["left_out_errors"] = _left_out_errors(left_out, d)
        page["left_out_causes"] = _left_out_causes(left_out)
    sections = []
    for c in d.causes:
        by_joint = {"arm" if j == 0 else f"joint {j}": x for j, x in sorted(c.parameters.items())}
        mine = cause_named(c.name).what_to_record
        what_would = {x: f"{mine}; {cause_named(x).what_to_record}" for x in c.confused_with}
        sections.append(section(c, by_joint, parameter_units(), what_would, pictures.pop(c.name)))
    return page | {
        "headline": headline,
        "pictures": {name: shown(x) for name, x in pictures.items()},
        "causes": sections,
        "residuals": _residuals(d),
        "links": "" if d.links is None else _links(d.links),
        "links_known": d.baseline.links is not None,
        "forward": forward,
        "seconds": SECONDS,
        "replay": REPLAY,
        "check": check,
        "check_worse": checks.WORSE,
        "left_out": left_out,
        "about_logs": [
            *_about(d.logs),
            *_about(check.logs if check else (), " (check)"),
            *dict.fromkeys((*d.notes, *(check.notes if check else ()))),
        ],
    }


def _drawn(
    d: Diagnosis, plots: Path, forward: ForwardValidation | str, check: Check | None
) -> dict[str, Picture]:
    """Draw all pictures of a report of logs; return them by name, those of causes by the cause."""
    caption = "Root mean square residual on data that was not fitted."
    summary = (d.nominal_rms, d.extended_rms, d.noise, plots / "summary.png")
    joints = JointPictures(d)
    out = {"summary": draw_summary(*summary, "held-out residual [N·m]", caption)}
    for j in range(1, d.data.n + 1):
        out[f"joint {j}"] = joints.draw(j - 1, plots / f"joint_{j}.png")
    if isinstance(forward, ForwardValidation):
        out["forward"] = draw_forward(forward, plots / "forward.png")
    if check is not None:
        out["check"] = draw_check(check, plots / "check.png")
    for c in d.causes:
        out[c.name] = draw_cause(d, c, plots / f"cause_{c.name}.png")
    return out


def _links(links: LinkErrors) -> str:
    """Return mass and centre that each link has more than the model."""
    rows = [
        [
            f"link {k}",
            f"{short(mass[0])} ± {short(mass[1])}",
            *(f"{1e3 * x:.1f} ± {1e3 * width:.1f}" for x, width in centre),
        ]
        for k, (mass, centre) in enumerate(zip(links.mass, links.centre, strict=True), start=1)
    ]
    return table_text(["", "mass [kg]", "centre x [mm]", "y [mm]", "z [mm]"], rows)


def _residuals(d: Diagnosis) -> str:
    rows, close = [], d.settings.verdict.close
    for j, (before, after, noise, missing) in enumerate(
        zip(d.nominal_rms, d.extended_rms, d.noise, d.structured, strict=True), 1
    ):
        gain = f"{number(100 * (1 - after / before), 0)} %"
        said = ", a cause is missing" if missing else "" if after > close * noise else ", explained"
        left = f"{after / noise:.1f} × the noise{said}"
        rows.append([f"joint {j}", short(before), short(after), gain, short(noise), left])
    return table_text(["joint", "nominal", "extended", "gain", "noise floor", "left"], rows)


def _forward_errors(forward: ForwardValidation) -> str:
    n, e = forward.nominal, forward.extended
    columns = zip(
        *(n.position_rms, e.position_rms, forward.position_gain),
        *(n.torque_rms, e.torque_rms, forward.torque_gain),
        strict=True,
    )
    rows = [
        [f"joint {j}", short(a), short(b), f"{number(c, 0)} %",
         short(x), short(y), f"{number(z, 0)} %"]
        for j, (a, b, c, x, y, z) in enumerate(columns, 1)
    ]  # fmt: skip
    means = [f"**{number(x.mean(), 0)} %**" for x in (forward.position_gain, forward.torque_gain)]
    rows.append(["mean gain", "", "", means[0], "", "", means[1]])
    header = ["joint", "replay, nominal [rad]", "extended [rad]", "gain"]
    return table_text([*header, "tracking, nominal [N·m]", "extended [N·m]", "gain"], rows)


def _check_errors(check: Check, d: Diagnosis) -> str:
    rows = []
    for j, (before, after) in enumerate(zip(check.nominal_rms, check.extended_rms, strict=True)):
        change = percent(100 * (after / before - 1), 0) if before > 0 else "–"
        cells = [short(before), short(after), change, short(check.noise[j])]
        said = "**worse**" if j + 1 in check.worse_joints else "holds"
        rows.append([f"joint {j + 1}", *cells, short(d.extended_rms[j]), said])
    header = ["joint", "nominal [N·m]", "extended [N·m]", "change", "noise floor [N·m]"]
    return table_text([*header, "held out in the diagnosis [N·m]", ""], rows)


def _check_causes(check: Check) -> str:
    rows, least = [], check.data.settings.selection.least_torque
    for x in check.transfers:
        for j in np.flatnonzero(x.torque > least * check.noise):
            harm = "**does not transfer**" if x.fails else "makes it worse"
            cells = [short(v) for v in (x.torque[j], x.without[j], check.extended_rms[j])]
            marked = harm if j + 1 in x.harmed else ""
            rows.append([x.name, f"joint {j + 1}", *cells, number(x.share[j], 2), marked])
    header = ["cause", "", "its torque [N·m]", "error without it [N·m]", "with it [N·m]"]
    return table_text([*header, "share", ""], rows) if rows else ""


def _left_out_errors(left_out: LeftOutMotion, d: Diagnosis) -> str:
    rows = []
    for j, before in enumerate(left_out.nominal_rms):
        k = int(np.nanargmax(left_out.extended[:, j]))
        worst = (
            f"{short(left_out.extended[k, j])} (`{left_out.motions[k]}`, "
            f"nominal {short(left_out.nominal[k, j])})"
        )
        cells = [short(x) for x in (before, d.extended_rms[j], left_out.extended_rms[j])]
        rows.append([f"joint {j + 1}", *cells, worst])
    header = ["joint", "nominal [N·m]", "blocks of time left out [N·m]"]
    return table_text([*header, "motions left out [N·m]", "of them the worst [N·m]"], rows)


def _left_out_causes(left_out: LeftOutMotion) -> str:
    rows = []
    for c in left_out.causes:
        named = listed(f"`{x}`" for x in c.motions)
        many = named if len(c.motions) < 3 else f"{len(c.motions)} motions"
        verdict = f"**{c.verdict}**" if c.verdict == "does not transfer" else c.verdict
        cells = [short(c.without_nm), short(c.with_nm), number(c.share, 2)]
        rows.append([c.name, f"joint {c.joint}", many or "none", *cells, verdict])
    header = ["cause", "", "judged on", "error without it [N·m]", "with it [N·m]", "share", ""]
    return table_text(header, rows) if rows else ""


def _about(logs: Sequence[JointLog], kind: str = "") -> list[str]:
    """Return each log's content, its corrections, and its defects that were not corrected."""
    out = []
    for log in logs:
        name = f"`{Path(log.source).name}`"
        rows, seconds = len(log.t), 0.0 if log.static else float(log.t[-1] - log.t[0])
        what = f"{rows} poses at rest" if log.static else f"{rows} rows, {seconds:.1f} s"
        out.append(f"{name}{kind}: {what}")
        out += [f"{name}: {c.text}" for c in log.corrections]
        out += [f"{name}: not corrected: {text}" for text in log.warnings]
    return out
