"""A diagnosis for people: `report.md`, `report.html` and the pictures in them.

write_report(folder, diagnosis, extension=extension, proof=proof, nominal_name="rigid")
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from stiction_envs.gap.diagnosis import CLOSE, Diagnosis, Estimate, NamedCause
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.forward_validation import EVERY, REPLAY, SECONDS, Proof
from stiction_envs.gap.least_squares import LeastSquares
from stiction_envs.gap.report_figures import (
    Drawn,
    draw_cause,
    draw_joint,
)
from stiction_envs.gap.report_scores import draw_proof, draw_summary
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.html import to_html
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.reporting.markdown import listed, plural, short, table

PLOTS = "plots"
UNITS = {
    "coulomb_nm": "N·m",
    "viscous_nms": "N·m·s/rad",
    "stiction_nm": "N·m",
    "stribeck_velocity": "rad/s",
    "asymmetry_nm": "N·m",
    "bristle_stiffness": "N·m/rad",
    "bristle_damping": "N·m·s/rad",
    "ripple_nm": "N·m",
    "periods_per_rev": "1/rev",
    "phase_rad": "rad",
    "drift_nm_per_s": "N·m/s",
    "offset_nm": "N·m",
    "mass_kg": "kg",
    "com_m": "m",
    "tilt_rad": "rad",
    "azimuth_rad": "rad",
    "armature_kgm2": "kg·m²",
    "gap_rad": "rad",
    "stiffness_nm_per_rad": "N·m/rad",
    "delay_s": "s",
    "rest_rad": "rad",
    "time_constant_s": "s",
}
"""Unit of every parameter of `diagnosis.json` that has one."""
HEADLINES = {
    "explained": "The named causes explain what the simulation gets wrong, down to the noise.",
    "partly explained": "The named causes explain part of what the simulation gets wrong.",
    "no discrepancy": "The simulation agrees with the logs; no cause stands against the noise.",
    "cannot tell": "The simulation and the logs disagree, or the arm moved too little to say; "
    "these data cannot tell why.",
}


def write_report(
    folder: Path,
    d: Diagnosis,
    *,
    extension: Extension,
    proof: Proof | str,
    nominal_name: str = "rigid",
    squares: LeastSquares | None = None,
    provenance: Iterable[tuple[str, str]] = (),
) -> list[str]:
    """Write ``report.md``, ``report.html`` and ``plots/``.

    Args:
        folder: an existing folder.
        d: the diagnosis.
        extension: the model with its causes.
        proof: of the model forward, or why there is none.
        nominal_name: what the diagnosis stood on.
        squares: the thesis's least squares, where they were asked for.
        provenance: rows of a table at the end.

    Returns:
        The names of the files written, pictures too.
    """
    (folder / PLOTS).mkdir(exist_ok=True)
    drawn = _draw(folder / PLOTS, d, proof)
    lines = [
        f"# What the simulation of {d.robot} gets wrong",
        "",
        *_verdict(d, nominal_name),
        *_picture(drawn["summary"]),
        *_causes(d, drawn),
        *_numbers(d, nominal_name),
        *_forward(proof, extension, drawn),
        *(_squares(squares, d) if squares is not None else []),
        *_next(d),
        *_logs(d),
        *_overview(d, drawn),
        "## Provenance",
        "",
        *table(["", ""], [[a, b] for a, b in provenance]),
    ]
    write_text_atomic(folder / "report.md", "\n".join(lines).rstrip("\n") + "\n")
    page = to_html(lines, folder, f"Diagnosis of {d.robot}: {d.verdict}")
    write_text_atomic(folder / "report.html", page)
    return ["report.md", "report.html", *(f"{PLOTS}/{x.file}" for x in drawn.values())]


def _draw(folder: Path, d: Diagnosis, proof: Proof | str) -> dict[str, Drawn]:
    out = {"summary": draw_summary(d, folder / "summary.png")}
    for cause in d.causes:
        out[cause.name] = draw_cause(d, cause, folder / f"cause_{cause.name}.png")
    for j in range(d.data.n):
        out[f"joint {j + 1}"] = draw_joint(d, j, folder / f"joint_{j + 1}.png")
    if isinstance(proof, Proof):
        out["forward"] = draw_proof(proof, folder / "forward.png")
    return out


def _picture(drawn: Drawn) -> list[str]:
    alt = drawn.file.removesuffix(".png").replace("_", " ")
    return [f"![{alt}]({PLOTS}/{drawn.file})", "", drawn.caption, ""]


def _signed(x: float) -> str:
    return short(x) if np.isfinite(x) else "–"


def verdict_sentences(d: Diagnosis, nominal_name: str = "rigid") -> str:
    """Return the verdict in two sentences."""
    first = HEADLINES[d.verdict]
    before, after = d.nominal_rms, d.extended_rms
    if not d.causes:
        left = [j + 1 for j in range(d.data.n) if before[j] > CLOSE * d.noise[j]]
        where = f"{joint_list(left)} above {CLOSE:g} times it" if left else "no joint far above it"
        return (
            f"{first} Held-out residuals of the {nominal_name} model are {short(before.min())} to "
            f"{short(before.max())} N·m, noise floors {short(d.noise.min())} to "
            f"{short(d.noise.max())} N·m, {where}."
        )
    names = [f"{c.name} ({joint_list(c.joints) if c.joints else 'whole arm'})" for c in d.causes]
    return (
        f"{first} {listed(names)}, strongest first, take {d.gain_percent:.0f} % off the held-out "
        f"residual, from {short(before.mean())} to {short(after.mean())} N·m in the mean of the "
        "joints."
    )


def _verdict(d: Diagnosis, nominal_name: str) -> list[str]:
    return [f"**{d.verdict}.** {verdict_sentences(d, nominal_name)}", ""]


def _causes(d: Diagnosis, drawn: dict[str, Drawn]) -> list[str]:
    lines = ["## Causes", ""]
    if not d.causes:
        return [*lines, "None stands against the noise.", ""]
    for k, cause in enumerate(d.causes, 1):
        where = joint_list(cause.joints) if cause.joints else "whole arm"
        lines += [f"### {k}. {cause.name}, {where}", "", f"{_sentence(cause.evidence)}", ""]
        lines += [
            f"Taken out alone, the held-out residual rises by {cause.gain_percent:.1f} % of the "
            "nominal one.",
            "",
        ]
        if cause.confused_with:
            lines += [
                f"**These data cannot tell it from {listed(cause.confused_with)}.** What would: "
                f"{d.library.causes[cause.name].record}"
                + (f"; {cause.tell_apart}" if cause.tell_apart else "")
                + ".",
                "",
            ]
        lines += _picture(drawn[cause.name])
        lines += _parameters(cause)
    return lines


def _sentence(text: str) -> str:
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."


def _parameters(cause: NamedCause) -> list[str]:
    rows = []
    for joint, found in sorted(cause.parameters.items()):
        for name, e in found.items():
            where = "arm" if joint == 0 else f"joint {joint}"
            label = f"`{name}` [{UNITS.get(name, '–')}]"
            bound = "**on its bound**" if e.on_bound else ""
            rows.append([where, label, *_values(e), bound])
    return table(["where", "parameter", "value", "95 % interval", ""], rows)


def _values(e: Estimate) -> tuple[str, str]:
    if isinstance(e.value, list):
        value = ", ".join(_signed(x) for x in e.value)
        return value, ", ".join(f"{_signed(a)} to {_signed(b)}" for a, b in e.ci95)
    return _signed(e.value), f"{_signed(e.ci95[0])} to {_signed(e.ci95[1])}"


def _numbers(d: Diagnosis, nominal_name: str) -> list[str]:
    rows = []
    for j in range(d.data.n):
        before, after, noise = d.nominal_rms[j], d.extended_rms[j], d.noise[j]
        gain = 100 * (1 - after / before)
        left = f"{after / noise:.1f} × the noise" + ("" if after > CLOSE * noise else ", explained")
        cells = [short(before), short(after), f"{gain:.0f} %", short(noise), left]
        rows.append([f"joint {j + 1}", *cells])
    return [
        "## Held-out residual",
        "",
        f"Root mean square of measured less modelled torque [N·m], each of {d.data.blocks} blocks "
        f"of time under the fit of all others. Nominal model: {nominal_name}.",
        "",
        *table(["joint", "nominal", "extended", "gain", "noise floor", "left"], rows),
    ]


def _forward(proof: Proof | str, extension: Extension, drawn: dict[str, Drawn]) -> list[str]:
    lines = ["## Forward proof", ""]
    if isinstance(proof, str):
        lines += [f"None: {proof}.", ""]
    else:
        n, e = proof.nominal, proof.extended
        rows = [
            [
                f"joint {j + 1}",
                short(n.position_rms[j]),
                short(e.position_rms[j]),
                f"{proof.position_gain[j]:.0f} %",
                short(n.torque_rms[j]),
                short(e.torque_rms[j]),
                f"{proof.torque_gain[j]:.0f} %",
            ]
            for j in range(len(n.position_rms))
        ]
        rows.append(
            [
                *("mean gain", "", "", f"**{proof.position_gain.mean():.0f} %**"),
                *("", "", f"**{proof.torque_gain.mean():.0f} %**"),
            ]
        )
        lines += [
            f"Both models run in stock MuJoCo on {plural(len(proof.start), 'window')} of "
            f"{SECONDS:g} s, each from the measured state, in blocks that were not fitted "
            f"(one of {EVERY}; in which causes there are, all had a say). Replay: the measured "
            f"torques alone; how far the arm strays in {REPLAY:g} s. Tracking: what a servo must "
            "add to keep the arm on the measured motion.",
            "",
            *table(
                [
                    *("joint", "replay, nominal [rad]", "extended [rad]", "gain"),
                    *("tracking, nominal [N·m]", "extended [N·m]", "gain"),
                ],
                rows,
            ),
            *_picture(drawn["forward"]),
        ]
    if extension.missing:
        lines += [
            "What `model.xml` cannot express (in the proof above its torque along the measured "
            "motion is taken off the controls):",
            "",
            *(f"- {m}" for m in extension.missing),
            "",
        ]
    if extension.friction_missing:
        lines += [
            "What the friction tables of `model.toml` do not hold (its [[cause]] tables do):",
            "",
            *(f"- {m}" for m in extension.friction_missing),
            "",
        ]
    return lines


def _squares(squares: LeastSquares, d: Diagnosis) -> list[str]:
    rows = [
        [
            f"joint {x.joint} ({'+' if x.direction == '+' else '−'})",
            str(x.rows),
            _signed(x.intercept),
            _signed(x.slope),
            _signed(x.r2),
        ]
        for x in squares.lines
    ]
    lines = [
        "## The thesis's least squares (equation 3.1)",
        "",
        "A straight line of friction torque over speed per joint and direction, on raw signals; "
        "the intercept was to be the stiction band (thesis, sections 3.1 and 4.1).",
        "",
        *table(["joint", "samples", "intercept [N·m]", "slope [N·m·s/rad]", "R²"], rows),
        *table(
            ["joint", "its lines leave [N·m]", "the tool leaves [N·m]"],
            [
                [f"joint {j + 1}", short(squares.rms[j]), short(d.extended_rms[j])]
                for j in range(d.data.n)
            ],
        ),
        "Both on the filtered signals; the tool's number is held out, that of the lines is not.",
        "",
    ]
    if squares.breaks:
        lines += ["Where it breaks, and why:", ""]
        lines += [f"- joint {j}: {'; '.join(why)}" for j, why in sorted(squares.breaks.items())]
        lines.append("")
    return lines


def _next(d: Diagnosis) -> list[str]:
    items = [f"- {text}" for text in d.record] or ["- nothing: every cause could be seen"]
    return ["## What to record next", "", *items, ""]


def _logs(d: Diagnosis) -> list[str]:
    lines = ["## Logs, and what was mended", ""]
    for log in d.logs:
        seconds = float(log.t[-1] - log.t[0]) if not log.static else 0.0
        what = (
            f"{len(log.t)} poses at rest" if log.static else f"{len(log.t)} rows, {seconds:.1f} s"
        )
        name = Path(log.source).name
        lines.append(f"- `{name}`: {what}")
        lines += [f"- `{name}`: {m.text}" for m in log.mends]
        lines += [f"- `{name}`: not mended: {text}" for text in log.warnings]
    own = [x for log in d.logs for x in (*(m.text for m in log.mends), *log.warnings)]
    lines += [f"- {x}" for x in dict.fromkeys(d.notes) if not x.endswith(tuple(own))]
    return [*lines, ""]


def _overview(d: Diagnosis, drawn: dict[str, Drawn]) -> list[str]:
    lines = [
        "## Residual of each joint",
        "",
        "Against time, angle, speed, direction, load, acceleration and frequency. Lines: mean, "
        "bands: quartiles.",
        "",
    ]
    for j in range(d.data.n):
        lines += [f"### Joint {j + 1}", "", *_picture(drawn[f"joint {j + 1}"])]
    return lines
