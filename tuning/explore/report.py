"""report.md of a search: what was found, measured anew beside other tables, and what it met.

The words are in ``templates/search.md.j2``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.measured import SJERow, write_sje
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import signed, table_text
from stiction_envs.reporting.templates import write_page
from tuning.explore import figures
from tuning.explore.tracking import Table
from tuning.explore.trials import allowed, complete
from tuning.explore.verify import PATHS, Verified

if TYPE_CHECKING:
    from tuning.explore.search import SearchRun

TEMPLATE = Path(__file__).parents[1] / "templates" / "search.md.j2"
COMPARISON = ("table", "experiment", "where", "measure", "value", "low", "high")


def write_search_report(
    run: SearchRun, folder: Path, final: Table, verified: Verified
) -> dict[str, Any]:
    """Write verification.csv, comparison.csv, plots and report.md; return the summary."""
    objective = run.options.objective
    found = "search gte" if objective != "sje" else "search sje"
    _write_verification(folder / "verification.csv", run, verified, found)
    _write_comparison(folder / "comparison.csv", verified)
    _draw(run, folder, verified)
    tuned = verified.breakaway[found]
    reductions = {j: result.reduction for j, result in tuned.items()}
    mean = float(np.mean([reductions[j][0] if j in reductions else 0.0 for j in _joints(run)]))
    met = {r.joint: run.bounds.met(r) for r in final if r.amplitude_nm}
    summary: dict[str, Any] = {
        "robot": run.sje.sticking.arm.name,
        "objective": objective,
        "trials": {k: sum(len(r.trials) for r in group) for k, group in run.records.items()},
        "final": [
            {
                "joint": r.joint,
                "frequency_hz": r.frequency_hz,
                "amplitude_nm": r.amplitude_nm,
                "waveform": r.waveform,
                "offset_nm": r.offset_nm,
                "gate_rad_s": r.gate_rad_s,
                "bounds_met": met.get(r.joint, []),
            }
            for r in final
        ],
        "mean_reduction_percent": 100.0 * mean,
        "comparison": {
            name: {
                "mean_reduction_percent": 100.0 * _mean_reduction(run, verified, name),
                **(_tracking_summary(verified, name) if verified.tracking else {}),
            }
            for name in verified.breakaway
        },
    }
    write_page(
        folder / "report.md",
        TEMPLATE,
        summary=summary,
        objective=objective,
        final=_final(run, final),
        met={j: words for j, words in met.items() if words},
        joints=_joint_table(run, verified),
        paths=_path_table(verified) if verified.tracking else "",
        failed=sum(
            t.values is None for group in run.records.values() for r in group for t in r.trials
        ),
        shaken=sum(
            not allowed(t) for g in run.records.values() for r in g for t in complete(r.trials)
        ),
        landscape="sje" in run.records,
        pareto=run.options.pareto,
        draws=run.search.verify_draws,
        spread=run.search.spread,
    )
    return summary


def _joints(run: SearchRun) -> range:
    return range(1, run.sje.n + 1)


def _mean_reduction(run: SearchRun, verified: Verified, name: str) -> float:
    """Return a table's mean reduction over all joints; a joint it leaves alone counts 0."""
    found = verified.breakaway[name]
    return float(np.mean([found[j].reduction[0] if j in found else 0.0 for j in _joints(run)]))


def _tracking_summary(verified: Verified, name: str) -> dict[str, Any]:
    return {
        path: {
            "position_left": found.position[0],
            "orientation_left": found.orientation[0],
            "vibration_m": found.vibration_m,
            "vibration_at_rest_m": found.vibration_at_rest_m,
        }
        for path, found in verified.tracking[name].items()
    }


def _draw(run: SearchRun, folder: Path, verified: Verified) -> None:
    if "sje" in run.records:
        shown = {**({} if "search sje" not in run.found else {"search": run.found["search sje"]})}
        figures.landscape(run.records["sje"], {**shown, **run.others}, folder / "landscape.png")
        figures.fronts(
            run.records["sje"], list(run.limit["sje"]), verified, folder / "displacement.png"
        )
    figures.history(run.records, folder / "history.png")
    figures.importance(run.records, folder / "importance.png")
    if run.options.pareto:
        figures.pareto(run.records, folder / "pareto.png")
    if verified.tracking:
        figures.tables(verified, folder / "comparison.png")


def _write_verification(path: Path, run: SearchRun, verified: Verified, name: str) -> None:
    """Write the table that was found as measured anew, in the form of SJE tables."""
    robot, s = run.sje.sticking.arm.name, run.search
    rows = [
        SJERow(
            robot,
            joint,
            c.load,
            c.direction,
            found.row.frequency_hz,
            found.row.amplitude_nm,
            float(tau.mean()),
            float(tau.std(ddof=1)) if len(tau) > 1 else 0.0,
            len(tau) * s.verify_iterations,
            float(1.0 - ratio.mean()),
        )
        for joint, found in verified.breakaway[name].items()
        for c, tau, ratio in zip(
            configurations(run.sje.n, [joint]), found.tau.T, found.ratio.T, strict=True
        )
    ]
    if rows:
        write_sje(path, rows)


def _write_comparison(path: Path, verified: Verified) -> None:
    lines: list[tuple[Any, ...]] = []
    for name, joints in verified.breakaway.items():
        for j, found in joints.items():
            place = (name, "sje", f"joint {j}")
            lines.append((*place, "reduction", *found.reduction))
            lines.append((*place, "displacement_rad", found.displacement, "", ""))
    for name, paths in verified.tracking.items():
        for where, result in paths.items():
            place = (name, "gte", where)
            lines.append((*place, "position_left", *result.position))
            lines.append((*place, "orientation_left", *result.orientation))
            for measure in ("vibration_m", "vibration_at_rest_m", "power_w"):
                lines.append((*place, measure, getattr(result, measure), "", ""))
    write_lines(path, COMPARISON, lines)


def _final(run: SearchRun, final: Table) -> str:
    extra = [
        ("waveform", any(r.waveform != "sine" for r in final)),
        ("offset [N·m]", any(r.offset_nm for r in final)),
        ("gate [rad/s]", any(r.gate_rad_s for r in final)),
    ]
    header = ["joint", "f [Hz]", "A [N·m]", *(name for name, used in extra if used), "bounds met"]
    rows = []
    for r in final:
        more = [r.waveform, f"{r.offset_nm:.3f}", f"{r.gate_rad_s:.3f}"]
        shown = [x for x, (_, used) in zip(more, extra, strict=True) if used]
        words = ", ".join(run.bounds.met(r)) if r.amplitude_nm else "no dither helped"
        rows.append([f"{r.joint}", f"{r.frequency_hz:.1f}", f"{r.amplitude_nm:.3f}", *shown, words])
    return table_text(header, rows)


def _joint_table(run: SearchRun, verified: Verified) -> str:
    header = ["table", *(f"joint {j}" for j in _joints(run)), "mean"]
    rows = []
    for name, joints in verified.breakaway.items():
        row = [name]
        for j in _joints(run):
            if j not in joints:
                row.append("–")
                continue
            mean, low, high = (100 * x for x in joints[j].reduction)
            span = "" if np.isnan(low) else f" ({low:.0f} … {high:.0f})"
            row.append(f"{mean:.1f}{span}, {1e3 * joints[j].displacement:.3f} mrad")
        rows.append([*row, f"{100 * _mean_reduction(run, verified, name):.1f}"])
    return table_text(header, rows)


def _path_table(verified: Verified) -> str:
    header = ["table", "path", "position left [%]", "orientation left [%]"]
    header += ["vibration [mm]", "at rest [mm]", "power [W]"]
    rows = []
    for name, found in verified.tracking.items():
        for path in PATHS:
            r = found[path]
            row = [name, path]
            for mean, low, high in (r.position, r.orientation):
                span = "" if np.isnan(low) else f" ({100 * low:.0f} … {100 * high:.0f})"
                row.append(f"{100 * mean:.1f}{span}")
            row += [f"{1e3 * r.vibration_m:.4f}", f"{1e3 * r.vibration_at_rest_m:.4f}"]
            rows.append([*row, signed(r.power_w, 2).lstrip("+")])
    return table_text(header, rows)
