"""Files of the reproduced tables: `tables.csv`, `tables.md`, scatter and appendix figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import (
    LOADS,
    Configuration,
    Job,
    Measurement,
    configurations,
    load_protocol,
)
from stiction_envs.measured import thesis_dithered, thesis_robots
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import signed, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.thesis.tables import (
    TITLES,
    TUNED,
    Reproduced,
    TableRow,
    scores,
)

Progress = Callable[[str, float, float], None]
POSES = {"load": "load", "no_load": "no load"}
COLOURS = {
    "4.3": "#1f5fa8",
    "4.5": "#7a7a7a",
    "4.6": "#2a9d8f",
    "4.7": "#8f6bb3",
    "4.8": "#c98a1b",
    "4.10": "#c2410c",
}


def write_tables(
    folder: Path, found: Reproduced, *, progress: Progress | None = None
) -> dict[str, dict[str, float]]:
    """Write all files.

    Args:
        folder: where; it exists.
        found: what was simulated.
        progress: called with (stage, done, total).

    Returns:
        `scores` of the tables.
    """
    header = [f.name for f in fields(TableRow)]
    rows = [[int(x) if isinstance(x, bool) else x for x in astuple(r)] for r in found.rows]
    write_lines(folder / "tables.csv", header, rows)
    _scatter(found.rows, folder / "tables.png")
    figures = _appendices(folder, found, progress)
    marks = scores(found.rows)
    write_md_and_html(
        folder,
        Path(__file__).parent / "templates" / "tables.md.j2",
        "The thesis's tables, simulated beside measured",
        ("tables.md", "report.html"),
        overview=_overview(marks),
        tables=list(_tables(found)),
        figures=figures,
    )
    return marks


# ---- page ----------------------------------------------------------------------------------------


def _name(c: Configuration, robot: str = "") -> str:
    sign = "+" if c.direction == "+" else "−"
    return f"{robot} {c.joint} {POSES[c.load]} ({sign})".strip()


def _torque(value: float, digits: int) -> str:
    return "stuck" if math.isnan(value) else signed(value, digits)


def _overview(marks: Mapping[str, Mapping[str, float]]) -> str:
    rows = [
        [
            f"[{number}](#table-{number.replace('.', '')})",
            TITLES[number],
            f"{s['cells']:.0f}",
            *(f"{s[k]:.1f} %" for k in ("mean", "median", "largest")),
        ]
        for number, s in marks.items()
    ]
    return table_text(["table", "", "cells", "mean difference", "median", "largest"], rows)


def _tables(found: Reproduced) -> Iterator[dict[str, Any]]:
    for number, title in TITLES.items():
        mine = [r for r in found.rows if r.table == number]
        if number == "4.9" and found.chosen:
            text = _chosen(found)
        elif mine:
            text = _base(mine) if number == "4.3" else _dithered(number, mine)
        else:
            continue
        yield {
            "number": number,
            "title": title,
            "text": text,
            "broken": any(r.outlier for r in mine),
            "no_effect": number == "4.5" and not any(r.simulated_change_pct for r in mine),
        }


def _base(rows: Sequence[TableRow]) -> str:
    body = [
        [
            _name(r.configuration, thesis_robots()[r.robot].title),
            f"{_torque(r.simulated_nm, 4)}" + _spread(r),
            _torque(r.measured_nm, 4),
            f"{_torque(r.difference, 2)} %",
        ]
        for r in rows
    ]
    header = ["robot, joint, pose, direction", "simulated [N·m]", "measured [N·m]", "difference"]
    return table_text(header, body)


def _spread(r: TableRow) -> str:
    return "" if math.isnan(r.simulated_std_nm) else f" ± {r.simulated_std_nm:.4f}"


def _dithered(number: str, rows: Sequence[TableRow]) -> str:
    key: Callable[[TableRow], Any] = (
        (lambda r: r.amplitude_set) if number == "4.10" else (lambda r: r.frequency_hz)
    )
    columns = list(dict.fromkeys(map(key, rows)))
    lines: dict[Configuration, dict[Any, str]] = {}
    for r in rows:
        text = f"{_torque(r.simulated_nm, 3)} ({_torque(r.simulated_change_pct, 1)})"
        text += f" / {_torque(r.measured_nm, 3)} ({_torque(r.measured_change_pct, 1)})"
        lines.setdefault(r.configuration, {})[key(r)] = text + (" †" if r.outlier else "")
    header = ["joint, pose, direction"]
    header += [c if isinstance(c, str) else f"{c:g} Hz" for c in columns]
    body = [[_name(c), *(found.get(k, "") for k in columns)] for c, found in lines.items()]
    return table_text(header, body)


def _chosen(found: Reproduced) -> str:
    body = [
        [
            str(c.joint),
            f"{c.measured_frequency_hz:g}, {c.measured_scale:g}, {c.measured_final_nm:.4f}",
            f"{c.simulated_frequency_hz:g}, {c.simulated_scale:g}, {c.simulated_final_nm:.4f}",
            c.reason,
        ]
        for c in found.chosen
    ]
    return table_text(["joint", "by hand: f [Hz], scale, A [N·m]", "simulated", "why that A"], body)


# ---- figures -------------------------------------------------------------------------------------


def _scatter(rows: Sequence[TableRow], path: Path) -> None:
    figure = Figure(figsize=(11.5, 5.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (robot, printed), marker in zip(thesis_robots().items(), ("o", "s"), strict=True):
        mine = [r for r in rows if r.table == "4.3" and r.robot == robot]
        _points(left, [(r.measured_nm, r.simulated_nm) for r in mine], marker, printed.title)
    left.set_title("base torques (Table 4.3)")
    left.set_xlabel("measured [N·m]")
    left.set_ylabel("simulated [N·m]")
    for number in ("4.6", "4.7", "4.8", "4.10", "4.5"):
        mine = [r for r in rows if r.table == number and not r.outlier]
        pairs = [(r.measured_change_pct, r.simulated_change_pct) for r in mine]
        label = f"Table {number}" + (" (iiwa)" if number == "4.5" else "")
        marker = "s" if number == "4.5" else "o"
        _points(right, pairs, marker, label, COLOURS[number])
    broken = sum(r.outlier for r in rows)
    right.set_title("change by dither" + (f" ({broken} broken cell left out)" if broken else ""))
    right.set_xlabel("measured [% of base torque]")
    right.set_ylabel("simulated [% of base torque]")
    for axes in (left, right):
        ends = [*axes.get_xlim(), *axes.get_ylim()]
        both = (min(ends), max(ends))
        axes.plot(both, both, color="0.35", lw=1, ls=(0, (4, 3)), zorder=1, label="equal")
        axes.set_xlim(both)
        axes.set_ylim(both)
        axes.set_aspect("equal")
        axes.axhline(0, color="0.8", lw=0.8, zorder=0)
        axes.axvline(0, color="0.8", lw=0.8, zorder=0)
        axes.grid(alpha=0.25, lw=0.6)
        axes.legend(frameon=False, fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle("The thesis's torques, simulated with the shipped friction")
    save_full(figure, path)


def _points(
    axes: Axes,
    pairs: Sequence[tuple[float, float]],
    marker: str,
    label: str,
    colour: str | None = None,
) -> None:
    x, y = np.array(pairs, dtype=float).reshape(-1, 2).T
    axes.plot(x, y, marker, ms=5, alpha=0.7, mew=0, color=colour, label=label, zorder=3)


def _appendices(folder: Path, found: Reproduced, progress: Progress | None) -> list[str]:
    """Draw every joint and pose without dither, and the Panda's with the final one."""
    final = {
        Configuration(r.joint, r.load, r.direction): Job(
            Configuration(r.joint, r.load, r.direction), r.frequency_hz, r.amplitude_nm
        )
        for r in thesis_dithered(TUNED)
        if r.amplitude_set == "final"
    }
    tasks: list[tuple[str, str, list[Measurement]]] = []
    for robot, measured in found.measured.items():
        for joint in range(1, 8):
            for load in LOADS:
                cs = [c for c in configurations(7, [joint]) if c.load == load]
                name = f"{robot}_joint{joint}_{load}"
                tasks.append((f"{name}_base.png", robot, [measured[Job(c)] for c in cs]))
                if robot == TUNED:
                    dithered = [measured[final[c]] for c in cs]
                    tasks.append((f"{name}_final.png", robot, dithered))
    (folder / "plots").mkdir(exist_ok=True)
    names = []
    for done, (name, robot, group) in enumerate(tasks):
        protocol = load_protocol(robot)
        shown = [m for m in group if m.traces and all(len(t) for t in m.traces)]
        if shown:
            plots.plot_sje(
                shown,
                folder / "plots" / name,
                robot=robot,
                threshold=protocol.threshold,
                ramp_rate=protocol.ramp_rate,
            )
            names.append(f"plots/{name}")
        if progress is not None:
            progress("figures", done + 1, len(tasks))
    names += _with_and_without(folder, found.measured, final)
    return names


def _with_and_without(
    folder: Path, measured: Mapping[str, Mapping[Job, Measurement]], final: Mapping[Any, Job]
) -> list[str]:
    """Draw the joint that dither helps most, with and without it, on one axis."""
    tuned = measured[TUNED]
    change = {c: abs(tuned[j].mean) / abs(tuned[Job(c)].mean) for c, j in final.items()}
    good = {c: x for c, x in change.items() if math.isfinite(x)}
    if not good:
        return []
    best = min(good, key=good.__getitem__)
    protocol = load_protocol(TUNED)
    plots.plot_with_and_without(
        tuned[Job(best)],
        tuned[final[best]],
        folder / "plots" / f"{TUNED}_best.png",
        robot=TUNED,
        threshold=protocol.threshold,
        ramp_rate=protocol.ramp_rate,
    )
    return [f"plots/{TUNED}_best.png"]
