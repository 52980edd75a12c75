"""report.md: what was tuned, and how it was verified.

The text is in ``templates/``; this module makes its numbers and tables.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration, Measurement
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.measured.tables import AMPLITUDE_COLUMNS, BaseTable
from stiction_envs.measured.thesis_tables import thesis_dithered, thesis_robots
from stiction_envs.reporting.markdown import signed, table_text
from stiction_envs.reporting.templates import write_md_and_html
from tuning.protocol import figures
from tuning.protocol.stages import Choice, ThesisTuner, Verified, change

TEMPLATE = Path(__file__).parents[1] / "templates" / "report.md.j2"
PLACE = "joint, pose, direction"


def _name(c: Configuration) -> str:
    return f"{c.joint} {c.load.replace('_', ' ')} ({c.direction.replace('-', '−')})"


def _base_table(tuner: ThesisTuner, measured: BaseTable | None) -> str:
    rows = []
    for c, m in tuner.base.items():
        row = [_name(c), f"{signed(m.mean, 4)} ± {m.std:.4f}"]
        if measured is not None:
            value = float(measured.tau[c.index])
            row += [signed(value, 4), f"{signed(100 * (m.mean / value - 1), 2)} %"]
        rows.append(row)
    header = [PLACE, "simulated τ_b [N·m]"]
    if measured is not None:
        header += ["measured τ_b [N·m]", "difference"]
    return table_text(header, rows)


def _choices(tuner: ThesisTuner, choices: list[Choice]) -> str:
    header = ["joint", "f [Hz]", "scale", "intermediate: load +, −; no load +, − [N·m]"]
    header += ["final A [N·m]", "why"]
    servos = tuner.experiment.servos is not None
    if servos:
        header.append("A/K [mrad]")
    rows = []
    for c in choices:
        cells = [str(c.row.joint), f"{c.row.frequency_hz:g}", f"{c.scale:g}"]
        cells += [", ".join(f"{a:.3f}" for a in c.intermediate.ravel())]
        cells += [f"{c.row.amplitude_nm:.4f}", c.reason]
        if servos:
            cells.append(f"{1e3 * tuner.angle(c):.1f}")
        rows.append(cells)
    return table_text(header, rows)


def _verification(tuner: ThesisTuner, verified: Verified) -> str:
    rows = []
    for c, base in tuner.base.items():
        found = [verified[kind][c] for kind in ("intermediate", "final")]
        cells = [f"{signed(m.mean, 4)} ({signed(change(m, base))} %)" for m in found]
        rows.append([_name(c), signed(base.mean, 4), *cells])
    return table_text([PLACE, "base [N·m]", "intermediate [N·m]", "final [N·m]"], rows)


def _caveats(tuner: ThesisTuner, reductions: dict[int, float], warnings: list[str]) -> list[str]:
    out = list(warnings)
    left_out = [f"{f:g}" for f in tuner.frequencies if f not in tuner.eligible]
    if left_out:
        out.append(
            f"measured, but not chosen from: {', '.join(left_out)} Hz (not below half the "
            "controller's rate)"
        )
    worse = [str(j) for j, r in reductions.items() if r < 0]
    if worse:
        out.append(f"not confirmed by the verification: joint {', '.join(worse)}")
    return out


def _reductions(tuner: ThesisTuner, final: Mapping[Configuration, Measurement]) -> dict[int, float]:
    """Return the reduction of the torque on each joint, mean over its configurations [%]."""
    each: dict[int, list[float]] = {}
    for c, m in final.items():
        each.setdefault(c.joint, []).append(-change(m, tuner.base[c]))
    return {joint: float(np.mean(values)) for joint, values in each.items()}


def write_report(
    tuner: ThesisTuner,
    choices: list[Choice],
    verified: Verified,
    *,
    table: BaseTable | None,
    warnings: list[str],
) -> dict[str, object]:
    """Write report.md and its plots; return the summary that ``--json`` prints."""
    sticking = tuner.experiment.sticking
    robot = sticking.arm.name
    reductions = _reductions(tuner, verified["final"])
    mean = float(np.mean(list(reductions.values())))
    name = sticking.arm.registered_name
    thesis = list(thesis_dithered(name)) if name in thesis_robots() else []
    figures.frequency(tuner, thesis, tuner.out / "frequency.png")
    figures.verification(tuner, verified["final"], thesis, tuner.out / "verification.png")
    worst = None
    if table is not None:
        found = [m.mean / table.tau[c.index] for c, m in tuner.base.items()]
        worst = float(np.max(np.abs(100 * (np.array(found) - 1))))
    write_md_and_html(
        tuner.out,
        TEMPLATE,
        f"Dither amplitudes for {robot}",
        note=simulated_note(sticking.arm, sticking.parameters),
        robot=robot,
        mean=mean,
        reductions=reductions,
        best=max(reductions, key=reductions.__getitem__),
        least=min(reductions, key=reductions.__getitem__),
        count=len(verified["final"]),
        caveats=_caveats(tuner, reductions, warnings),
        choices=_choices(tuner, choices),
        servos=tuner.experiment.servos is not None,
        base=_base_table(tuner, table),
        verification=_verification(tuner, verified),
    )
    return {
        "robot": robot,
        "final": [
            {name: getattr(c.row, name) for name in AMPLITUDE_COLUMNS}
            | ({} if tuner.experiment.servos is None else {"amplitude_rad": tuner.angle(c)})
            for c in choices
        ],
        "mean_reduction_percent": mean,
        "reduction_percent": reductions,
        "largest_base_difference_percent": worst,
        "warnings": warnings,
        "report": str(tuner.out / "report.md"),
    }
