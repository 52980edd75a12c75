"""report.md: what was tuned, and the thesis's tables simulated beside measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement, configurations
from stiction_envs.measured import (
    BaseTable,
    DitheredRow,
    thesis_base,
    thesis_dithered,
    thesis_table,
)
from stiction_envs.reporting.atomic import write_text_atomic
from tuning import figures
from tuning.rules import Choice
from tuning.thesis import ThesisTuner

Verified = dict[str, dict[Job, Measurement]]
LOAD_NAMES = {"load": "load", "no_load": "no load"}


def _name(c: Configuration) -> str:
    return f"{c.joint} {LOAD_NAMES[c.load]} ({c.direction})"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return [*lines, *("| " + " | ".join(r) + " |" for r in rows), ""]


def change(m: Measurement, base: Measurement) -> float:
    """Return the change of |τ| against the base, per cent; negative is less torque."""
    return 100.0 * (abs(m.mean) / abs(base.mean) - 1.0)


def pair(
    tuner: ThesisTuner, verified: Verified, row: DitheredRow
) -> tuple[Measurement, Measurement] | None:
    """Return (simulated, its base) of a row of Tables 4.5–4.8 and 4.10; None if not simulated."""
    c = Configuration(row.joint, row.load, row.direction)
    if row.table == "4.10":
        found = next(
            (m for j, m in verified[row.amplitude_set].items() if j.configuration == c), None
        )
    else:
        found = tuner.cells.get(tuner.job(c, row.frequency_hz, row.scale))
    return None if found is None else (found, tuner.base[c])


def thesis_rows(tuner: ThesisTuner) -> list[DitheredRow]:
    """Return the measured dithered torques of the arm, none if the thesis has no such arm."""
    name = tuner.experiment.sticking.arm.name
    return list(thesis_dithered(name)) if name in ("panda", "iiwa7") else []


def _measured_base(tuner: ThesisTuner, table: BaseTable | None) -> BaseTable | None:
    name = tuner.experiment.sticking.arm.name
    if table is not None:
        return table
    return thesis_base(name) if name in ("panda", "iiwa7") else None


def _base_section(tuner: ThesisTuner, measured: BaseTable | None) -> tuple[list[str], float]:
    rows, worst = [], float("nan")
    errors = []
    for c, m in tuner.base.items():
        cells = [_name(c), f"{m.mean:+.4f} ± {m.std:.4f}"]
        if measured is not None:
            value = measured.get(c.joint, c.load, c.direction)
            errors.append(100 * (m.mean / value - 1))
            cells += [f"{value:+.4f}", f"{errors[-1]:+.2f} %"]
        rows.append(cells)
    header = ["joint, pose, direction", "simulated τ_b [N·m]"]
    if measured is not None:
        header += ["measured τ_b [N·m]", "difference"]
        worst = float(np.max(np.abs(errors)))
    return ["## Base torques (Table 4.3)", "", *_table(header, rows)], worst


def _dither_section(
    title: str, rows: list[DitheredRow], tuner: ThesisTuner, verified: Verified, key: str
) -> list[str]:
    """One of Tables 4.5–4.8 and 4.10: a line per configuration, a column per setting."""
    columns = list(dict.fromkeys(getattr(r, key) for r in rows))
    lines: dict[Configuration, dict[Any, str]] = {}
    gaps = []
    for r in rows:
        c = Configuration(r.joint, r.load, r.direction)
        both = pair(tuner, verified, r)
        cell = f"– / {r.change_pct:+.1f}"
        if both is not None:
            simulated = change(*both)
            cell = f"{both[0].mean:+.3f} ({simulated:+.1f})"
            cell += f" / {r.tau_sje_nm:+.3f} ({r.change_pct:+.1f})"
            if not r.outlier:
                gaps.append(abs(simulated - r.change_pct))
        if r.outlier:
            cell += " †"
        lines.setdefault(c, {})[getattr(r, key)] = cell
    unit = " Hz" if key == "frequency_hz" else ""
    body = [[_name(c), *(cells.get(k, "") for k in columns)] for c, cells in lines.items()]
    header = ["joint, pose, direction", *(f"{k:g}{unit}" if unit else str(k) for k in columns)]
    out = [f"## {title}", "", "Cells: simulated N·m (change %) / measured N·m (change %).", ""]
    out += _table(header, body)
    if gaps:
        out += [
            f"Difference of the changes: mean {np.mean(gaps):.1f}, median {np.median(gaps):.1f} "
            "points of the base torque.",
            "",
        ]
    if any(r.outlier for r in rows):
        out += ["† not credible: the same setting repeated in Table 4.10 gives +1.65 %.", ""]
    return out


def _choice_section(choices: list[Choice], robot: str) -> list[str]:
    by_joint: dict[int, dict[str, Any]] = {}
    if robot == "panda":
        by_joint = {int(r["joint"]): r for r in thesis_table("4.9")}
    header = ["joint", "f [Hz]", "scale", "intermediate: load +, −; no load +, − [N·m]"]
    header += ["final A [N·m]", "why"]
    if by_joint:
        header += ["thesis: f [Hz], final A [N·m]"]
    rows = []
    for c in choices:
        cells = [str(c.joint), f"{c.frequency_hz:g}", f"{c.scale:g}"]
        cells += [", ".join(f"{a:.3f}" for a in c.intermediate.ravel()), f"{c.amplitude_nm:.4f}"]
        cells += [c.reason]
        if by_joint:
            r = by_joint[c.joint]
            cells += [f"{r['frequency_Hz']:g}, {abs(r['tau_final_Nm']):g}"]
        rows.append(cells)
    return ["## Final amplitude table (Table 4.9)", "", *_table(header, rows)]


def write_report(
    tuner: ThesisTuner,
    choices: list[Choice],
    verified: Verified,
    *,
    table: BaseTable | None,
    warnings: list[str],
) -> dict[str, Any]:
    """Write report.md and its plots; return the summary that ``--json`` prints."""
    arm = tuner.experiment.sticking.arm
    measured = _measured_base(tuner, table)
    rows = thesis_rows(tuner)
    base_lines, worst = _base_section(tuner, measured)
    reductions = {
        c.joint: float(
            np.mean(
                [
                    -change(m, tuner.base[j.configuration])
                    for j, m in verified["final"].items()
                    if j.configuration.joint == c.joint
                ]
            )
        )
        for c in choices
    }
    mean = float(np.mean(list(reductions.values())))
    best, least = (
        max(reductions, key=reductions.__getitem__),
        min(reductions, key=reductions.__getitem__),
    )
    lines = [
        f"# Dither amplitudes for {arm.name}",
        "",
        f"With the final table the torque to move a joint falls by {mean:.0f} % on average in "
        f"simulation, most on joint {best} ({reductions[best]:.0f} %), least on joint {least} "
        f"({reductions[least]:.0f} %). Verified on {len(verified['final'])} configurations "
        "measured anew with another seed.",
        "",
        *_caveats(tuner, reductions, warnings),
        *_choice_section(choices, arm.name),
        "![reduction against frequency](frequency.png)",
        "",
        "![verification](verification.png)",
        "",
        *base_lines,
        *([] if measured is None else ["![base torques](base.png)", ""]),
    ]
    titles = {
        "4.5": "First trials on the iiwa (Table 4.5)",
        "4.6": "Frequencies at scale 1.0 (Table 4.6)",
        "4.7": "Scale 1.2 (Table 4.7)",
        "4.8": "Scale 0.8 (Table 4.8)",
        "4.10": "Verification: intermediate and final amplitudes (Table 4.10)",
    }
    if not any(r.table == "4.10" for r in rows):
        lines += _own_verification(tuner, verified)
    for number, title in titles.items():
        mine = [r for r in rows if r.table == number]
        if mine:
            key = "amplitude_set" if number == "4.10" else "frequency_hz"
            lines += _dither_section(title, mine, tuner, verified, key)
    if any(r.table == "4.10" for r in rows):
        lines += [
            "In Table 4.10 each side uses its own amplitudes: ours from the table above, the "
            "thesis's from its Table 4.9.",
            "",
        ]
    figures.frequency(tuner, rows, tuner.out / "frequency.png")
    figures.verification(tuner, verified, rows, tuner.out / "verification.png")
    if measured is not None:
        figures.base(tuner, measured, tuner.out / "base.png")
    lines += figures.appendix(tuner, verified)
    write_text_atomic(tuner.out / "report.md", "\n".join(lines).rstrip() + "\n")
    return {
        "robot": arm.name,
        "final": [
            {"joint": c.joint, "frequency_hz": c.frequency_hz, "amplitude_nm": c.amplitude_nm}
            for c in choices
        ],
        "mean_reduction_percent": mean,
        "reduction_percent": reductions,
        "largest_base_difference_percent": None if np.isnan(worst) else worst,
        "warnings": warnings,
        "report": str(tuner.out / "report.md"),
    }


def _caveats(tuner: ThesisTuner, reductions: dict[int, float], warnings: list[str]) -> list[str]:
    lines = [f"> {w}" for w in warnings]
    left_out = [f"{f:g}" for f in tuner.frequencies if f not in tuner.eligible]
    if left_out:
        lines.append(
            f"> measured, but not chosen from: {', '.join(left_out)} Hz (not below half the "
            "controller's rate)"
        )
    worse = [str(j) for j, r in reductions.items() if r < 0]
    if worse:
        lines.append(f"> not confirmed by the verification: joint {', '.join(worse)}")
    # an empty quoted line between them keeps each a paragraph of its own
    return ["\n>\n".join(lines), ""] if lines else []


def _own_verification(tuner: ThesisTuner, verified: Verified) -> list[str]:
    rows = []
    for c in configurations(tuner.experiment.n):
        cells = [_name(c), f"{tuner.base[c].mean:+.4f}"]
        for kind in ("intermediate", "final"):
            m = next(m for j, m in verified[kind].items() if j.configuration == c)
            cells.append(f"{m.mean:+.4f} ({change(m, tuner.base[c]):+.1f} %)")
        rows.append(cells)
    header = ["joint, pose, direction", "base [N·m]", "intermediate [N·m]", "final [N·m]"]
    return ["## Verification", "", *_table(header, rows)]
