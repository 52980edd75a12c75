"""A diagnosis for people: `report.md`, `report.html` and the pictures in them.

write_report(folder, diagnosis, extension=extension, proof=proof, nominal_name="rigid")

The words are in ``templates/``; here are the numbers and tables that go into them.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from stiction_envs.friction.assumed import friction_note
from stiction_envs.gap.causes import parameter_units
from stiction_envs.gap.check import Check
from stiction_envs.gap.check import describe as describe_check
from stiction_envs.gap.diagnosis import Diagnosis, Estimate, NamedCause
from stiction_envs.gap.extended_model import Extension
from stiction_envs.gap.forward_validation import Proof
from stiction_envs.gap.least_squares import LeastSquares
from stiction_envs.gap.left_out_motion import LeftOutMotion
from stiction_envs.gap.report_check import (
    check_causes,
    check_errors,
    draw_check,
    left_out_causes,
    left_out_errors,
)
from stiction_envs.gap.report_figures import (
    Drawn,
    draw_cause,
    draw_joint,
)
from stiction_envs.gap.report_scores import draw_proof, draw_summary
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.reporting.markdown import number, short, table_text
from stiction_envs.reporting.templates import render, write_md_and_html

TEMPLATES = Path(__file__).parent / "templates"
PLOTS = "plots"


def write_report(
    folder: Path,
    d: Diagnosis,
    *,
    extension: Extension,
    proof: Proof | str,
    check: Check | None = None,
    left_out: LeftOutMotion | None = None,
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
        check: of the model on logs that took no part, where there are any.
        left_out: errors with one motion left out, where there are several.
        nominal_name: the baseline of the diagnosis.
        squares: the thesis's least squares, where they were asked for.
        provenance: rows of a table at the end.

    Returns:
        The names of the files written, pictures too.
    """
    (folder / PLOTS).mkdir(exist_ok=True)
    pictures = _draw(folder / PLOTS, d, proof, check)
    names = write_md_and_html(
        folder,
        TEMPLATES / "report.md.j2",
        f"Diagnosis of {d.robot}: {d.verdict}",
        note=friction_note(d.data.arm, d.baseline.friction),
        **_verdict(d, nominal_name),
        plots=PLOTS,
        pictures=pictures,
        what_shows={c.name: d.library.causes[c.name].what_to_record for c in d.causes},
        parameters={c.name: _parameters(c) for c in d.causes},
        residuals=_residuals(d),
        validation=proof,
        forward="" if isinstance(proof, str) else _forward(proof),
        windows=d.settings.forward,
        extension=extension,
        check=check,
        check_verdict="" if check is None else describe_check(check),
        check_errors="" if check is None else check_errors(check, d),
        check_causes="" if check is None else check_causes(check),
        check_logs=[] if check is None else [_log(log) for log in check.logs],
        left_out=left_out,
        left_out_errors="" if left_out is None else left_out_errors(left_out, d),
        left_out_causes="" if left_out is None else left_out_causes(left_out),
        squares=squares,
        squares_lines="" if squares is None else _lines(squares),
        squares_rms="" if squares is None else _line_residuals(squares, d),
        logs=[_log(log) for log in d.logs],
        notes=_notes(d),
        provenance=table_text(["", ""], [[a, b] for a, b in provenance]),
    )
    return [*names, *(f"{PLOTS}/{x.file}" for x in pictures.values())]


def _draw(folder: Path, d: Diagnosis, proof: Proof | str, check: Check | None) -> dict[str, Drawn]:
    out = {"summary": draw_summary(d, folder / "summary.png")}
    for cause in d.causes:
        out[cause.name] = draw_cause(d, cause, folder / f"cause_{cause.name}.png")
    for j in range(d.data.n):
        out[f"joint {j + 1}"] = draw_joint(d, j, folder / f"joint_{j + 1}.png")
    if isinstance(proof, Proof):
        out["forward"] = draw_proof(proof, folder / "forward.png")
    if check is not None:
        out["check"] = draw_check(check, folder / "check.png")
    return out


def verdict_sentences(d: Diagnosis, nominal_name: str = "rigid") -> str:
    """Return the verdict in two sentences."""
    return render(TEMPLATES / "verdict.j2", **_verdict(d, nominal_name)).strip()


def _verdict(d: Diagnosis, nominal_name: str) -> dict[str, Any]:
    close = d.settings.verdict.close
    return {
        "d": d,
        "nominal_name": nominal_name,
        "names": [
            f"{c.name} ({joint_list(c.joints) if c.joints else 'whole arm'})" for c in d.causes
        ],
        "unexplained": [j + 1 for j in range(d.data.n) if d.nominal_rms[j] > close * d.noise[j]],
        "close": close,
    }


def _parameters(cause: NamedCause) -> str:
    rows, units = [], parameter_units()
    for joint, found in sorted(cause.parameters.items()):
        for name, e in found.items():
            where = "arm" if joint == 0 else f"joint {joint}"
            label = f"`{name}` [{units.get(name, '–')}]"
            bound = "**on its bound**" if e.on_bound else ""
            rows.append([where, label, *_values(e), bound])
    return table_text(["where", "parameter", "value", "95 % interval", ""], rows)


def _values(e: Estimate) -> tuple[str, str]:
    if isinstance(e.value, list):
        value = ", ".join(short(x) for x in e.value)
        return value, ", ".join(f"{short(a)} to {short(b)}" for a, b in e.ci95)
    if isinstance(e.value, int):  # a choice, not a measure
        return str(e.value), ""
    return short(e.value), f"{short(e.ci95[0])} to {short(e.ci95[1])}"


def _residuals(d: Diagnosis) -> str:
    rows, close = [], d.settings.verdict.close
    for j in range(d.data.n):
        before, after, noise = d.nominal_rms[j], d.extended_rms[j], d.noise[j]
        gain = f"{number(100 * (1 - after / before), 0)} %"
        left = f"{after / noise:.1f} × the noise" + ("" if after > close * noise else ", explained")
        rows.append([f"joint {j + 1}", short(before), short(after), gain, short(noise), left])
    return table_text(["joint", "nominal", "extended", "gain", "noise floor", "left"], rows)


def _forward(proof: Proof) -> str:
    n, e = proof.nominal, proof.extended
    rows = [
        [
            f"joint {j + 1}",
            short(n.position_rms[j]),
            short(e.position_rms[j]),
            f"{number(proof.position_gain[j], 0)} %",
            short(n.torque_rms[j]),
            short(e.torque_rms[j]),
            f"{number(proof.torque_gain[j], 0)} %",
        ]
        for j in range(len(n.position_rms))
    ]
    means = [f"**{number(x.mean(), 0)} %**" for x in (proof.position_gain, proof.torque_gain)]
    rows.append(["mean gain", "", "", means[0], "", "", means[1]])
    header = ["joint", "replay, nominal [rad]", "extended [rad]", "gain"]
    return table_text([*header, "tracking, nominal [N·m]", "extended [N·m]", "gain"], rows)


def _lines(squares: LeastSquares) -> str:
    rows = [
        [
            f"joint {x.joint} ({x.direction.replace('-', '−')})",
            str(x.rows),
            short(x.intercept),
            short(x.slope),
            short(x.r2),
        ]
        for x in squares.lines
    ]
    header = ["joint", "samples", "intercept [N·m]", "slope [N·m·s/rad]", "R²"]
    return table_text(header, rows)


def _line_residuals(squares: LeastSquares, d: Diagnosis) -> str:
    rows = [
        [f"joint {j + 1}", short(squares.rms[j]), short(d.extended_rms[j])] for j in range(d.data.n)
    ]
    return table_text(["joint", "its lines leave [N·m]", "the tool leaves [N·m]"], rows)


def _log(log: Any) -> dict[str, Any]:
    seconds = 0.0 if log.static else float(log.t[-1] - log.t[0])
    return {
        "name": Path(log.source).name,
        "what": (
            f"{len(log.t)} poses at rest" if log.static else f"{len(log.t)} rows, {seconds:.1f} s"
        ),
        "corrected": [c.text for c in log.corrections],
        "warnings": log.warnings,
    }


def _notes(d: Diagnosis) -> list[str]:
    """Return what the diagnosis says that no log says of itself."""
    own = tuple(x for log in d.logs for x in (*(c.text for c in log.corrections), *log.warnings))
    return [x for x in dict.fromkeys(d.notes) if not x.endswith(own)]
