"""report.md of a search: its result, measured again and compared with other tables.

The text is in ``templates/search.md.j2``.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from stiction_envs.control.compensation_files import compensation_rows
from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.tables import SJERow, write_sje
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.templates import write_md_and_html
from tuning.protocol.tune import gains_table
from tuning.search import figures
from tuning.search.bounds import Table
from tuning.search.stages import SEARCHED, SearchStages
from tuning.search.trials import allowed, complete
from tuning.search.verify import AT_REST, NOTHING, PathResult, Verified

TEMPLATE = Path(__file__).parents[1] / "templates" / "search.md.j2"
COMPARISON = ("table", "experiment", "where", "measure", "value", "low", "high")


def write_search_report(found: SearchStages, folder: Path, verified: Verified) -> dict[str, object]:
    """Write verification.csv, comparison.csv, plots and report.md; return the summary."""
    objective, final = found.options.objective, found.final
    chosen = list(found.tables)[-1]
    _write_verification(folder / "verification.csv", found, verified, chosen)
    _write_comparison(folder / "comparison.csv", verified)
    if "sje" in found.records:
        tables = {**found.tables, **found.others}
        figures.landscape(found.bounds, found.records["sje"], tables, folder / "landscape.png")
    if found.options.pareto:
        figures.pareto(found.records, folder / "pareto.png")
    met = {r.joint: found.bounds.met(r) for r in final if r.amplitude_nm}
    gains = _gains(found)
    trials = [t for group in found.records.values() for r in group for t in r.trials]
    summary: dict[str, object] = {
        "robot": found.sje.sticking.arm.name,
        "objective": objective,
        "trials": {k: sum(len(r.trials) for r in group) for k, group in found.records.items()},
        "final": [{**asdict(r), "bounds_met": met.get(r.joint, [])} for r in final],
        "mean_reduction_percent": _mean_reduction(found, verified, chosen),
        "compensation": gains,
    }
    what, treatments = "Dither", ""
    if found.options.treatment is not None:
        what = "Treatment of friction"
        summary["treatment"], treatments = _treatments(found, verified)
    write_md_and_html(
        folder,
        TEMPLATE,
        f"{what} for {summary['robot']}, searched",
        note=simulated_note(found.sje.sticking.arm, found.sje.sticking.parameters),
        summary=summary,
        objective=objective,
        final=_final(found, final) if final else "",
        gains=table_text(*gains_table(gains)) if gains else "",
        met={j: words for j, words in met.items() if words},
        better=_better_without_dither(verified, found.chosen) if found.chosen == SEARCHED else [],
        treatments=treatments,
        winner=summary.get("treatment"),
        rest_margin=f"{1e3 * found.search.rest_margin:g}",
        joints=_joint_table(found, verified),
        paths=_path_table(verified) if verified.tracking else "",
        failed=sum(t.values is None for t in trials),
        shaken=sum(not allowed(t) for t in complete(trials)),
        landscape="sje" in found.records,
        pareto=found.options.pareto,
        draws=found.search.verify_draws,
        spread=found.search.spread,
    )
    return summary


def _mean_reduction(found: SearchStages, verified: Verified, name: str) -> float:
    """Return a table's mean reduction over all joints [%]; a joint without dither counts as 0."""
    joints = verified.breakaway[name]
    every = range(1, found.bounds.n + 1)
    each = [joints[j].reduction[0] if j in joints else 0.0 for j in every]
    return 100.0 * float(np.mean(each))


def _better_without_dither(verified: Verified, chosen: str) -> list[dict[str, object]]:
    """Return the compensations that leave less error than the table found, at no more vibration."""
    out, tuned = [], verified.tracking[chosen]
    for name, paths in verified.tracking.items():
        if name.endswith("as believed") and all(
            _error(x) < _error(tuned[p]) and x.totals[AT_REST] <= tuned[p].totals[AT_REST]
            for p, x in paths.items()
        ):
            kinds = ("position", "orientation")
            worst = {k: max(100 * x.left[k][0] for x in paths.values()) for k in kinds}
            out.append({"kind": name.split(",")[0], **worst})
    return out


def _error(result: PathResult) -> float:
    return result.left["position"][0] * result.left["orientation"][0]


def _treatments(found: SearchStages, verified: Verified) -> tuple[JsonRecord, str]:
    """Return the treatment that is recommended and the next, and a table of all that were searched.

    Each has the error that it leaves on unseen paths, and its prerequisites.
    """
    left = {name: 100 * found.left(verified.tracking, name) for name in found.treatments}
    ranked = found.ranking(verified.tracking)
    says = dict.fromkeys(ranked, "it may be used") | dict.fromkeys(ranked[:1], "yes")
    no = "no: it shakes at rest, or helps nothing"
    rows = [[name, f"{x:.1f}", says.get(name, no), found.needs(name)] for name, x in left.items()]
    header = ["treatment", "left on unseen paths [%]", "recommended", "needs to know"]
    winner: JsonRecord = {"name": NOTHING, "left_percent": 100.0, "next": None, "needs": "nothing"}
    if ranked:
        first, *rest = ({"name": name, "left_percent": left[name]} for name in ranked)
        winner = {**first, "next": rest[0] if rest else None, "needs": found.needs(ranked[0])}
    return winner, table_text(header, rows)


def _write_verification(path: Path, found: SearchStages, verified: Verified, name: str) -> None:
    """Write the table that was found, as measured again, in the form of SJE tables."""
    robot, dither = found.sje.sticking.arm.name, {r.joint: r for r in found.tables[name]}
    rows = [
        SJERow(
            robot,
            joint,
            c.load,
            c.direction,
            dither[joint].frequency_hz,
            dither[joint].amplitude_nm,
            float(tau.mean()),
            float(tau.std(ddof=1)) if len(tau) > 1 else 0.0,
            len(tau) * found.search.verify_iterations,
            float(1.0 - ratio.mean()),
        )
        for joint, result in verified.breakaway[name].items()
        for c, tau, ratio in zip(
            configurations(found.bounds.n, [joint]), result.tau.T, result.ratio.T, strict=True
        )
    ]
    if rows:
        write_sje(path, rows)


def _write_comparison(path: Path, verified: Verified) -> None:
    lines: list[tuple[str | float, ...]] = []
    for name, joints in verified.breakaway.items():
        for j, joint in joints.items():
            place = (name, "sje", f"joint {j}")
            lines.append((*place, "reduction", *joint.reduction))
            lines.append((*place, "displacement_rad", joint.displacement, "", ""))
    for name, paths in verified.tracking.items():
        for where, result in paths.items():
            place = (name, "gte", where)
            lines += [(*place, f"{name}_left", *three) for name, three in result.left.items()]
            lines += [(*place, name, total, "", "") for name, total in result.totals.items()]
    write_lines(path, COMPARISON, lines)


def _final(found: SearchStages, final: Table) -> str:
    header = ["joint", "f [Hz]", "A [N·m]", "bounds met"]
    rows = []
    for r in final:
        words = ", ".join(found.bounds.met(r)) if r.amplitude_nm else "no dither helped"
        rows.append([f"{r.joint}", f"{r.frequency_hz:.1f}", f"{r.amplitude_nm:.3f}", words])
    return table_text(header, rows)


def _gains(found: SearchStages) -> JsonRecord | None:
    """Return kind and numbers of the compensation that was found, per joint by their columns."""
    c = found.compensation
    if c is None:
        return None
    rows = compensation_rows(c)
    columns = [name for name in rows[0] if name != "joint"]
    return {"kind": c.kind, **{name: [row[name] for row in rows] for name in columns}}


def _joint_table(found: SearchStages, verified: Verified) -> str:
    every = range(1, found.bounds.n + 1)
    header = ["table", *(f"joint {j}" for j in every), "mean"]
    rows = []
    for name, joints in verified.breakaway.items():
        row = [name]
        for j in every:
            if j not in joints:
                row.append("–")
                continue
            reduction = _interval(*(100 * x for x in joints[j].reduction))
            row.append(f"{reduction}, {1e3 * joints[j].displacement:.3f} mrad")
        rows.append([*row, f"{_mean_reduction(found, verified, name):.1f}"])
    return table_text(header, rows)


def _path_table(verified: Verified) -> str:
    header = ["treatment", "path", "position left [%]", "orientation left [%]"]
    header += ["position at rest [%]", "orientation at rest [%]"]
    header += ["vibration [mm]", "at rest [mm]", "power [W]"]
    rows = []
    for name, paths in verified.tracking.items():
        for path, result in paths.items():
            left = [_interval(*(100 * x for x in three)) for three in result.left.values()]
            moving, resting = (f"{1e3 * result.totals[x]:.4f}" for x in ("vibration_m", AT_REST))
            rows.append([name, path, *left, moving, resting, number(result.totals["power_w"], 2)])
    return table_text(header, rows)


def _interval(mean: float, low: float, high: float) -> str:
    """Return a mean with its interval, which a single friction does not have."""
    return f"{mean:.1f}" if np.isnan(low) else f"{mean:.1f} ({low:.0f} … {high:.0f})"
