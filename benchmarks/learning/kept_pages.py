"""Pages of dither, policies, searches and treatments whose rows were measured once.

    python -m benchmarks.learning.kept_pages [--out FOLDER]

Writes each page and its picture of the rows in the CSV beside it; the page says how they were
measured.
"""

import csv
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.control.laws import LAWS
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.sje.plots import plain_axes
from stiction_envs.reporting.markdown import number, percent, signed, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.reporting.templates import render
from tuning.settings import tuning_settings

STUDY = Benchmark(__file__, __doc__)
ROBOTS = ("panda", "iiwa7", "iiwa14")
Lines = list[dict[str, str]]
"""Rows of a CSV."""


def read(name: str) -> Lines:
    """Return the rows of a CSV beside this file."""
    with (STUDY.folder / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# ---- tracking error against shaking: which dither removes the one without the other --------------

ERRORS = ("position", "orientation", "window", "path")
NOTHING, THESIS = "no dither", "sine (thesis) × 1"


def dither_tradeoff(folder: Path) -> dict[str, Any]:
    """Draw the picture into a folder; return what the page's template asks for."""
    lines = [dict(line) for line in read("dither_tradeoff")]
    rows = {x.pop("dither"): {k: float(v) for k, v in x.items()} for x in lines}
    _draw_dither(rows, folder / "dither_tradeoff.png")
    plain, thesis = rows[NOTHING], rows[THESIS]
    limit = 0.5 * (thesis["vibration_mm"] + plain["vibration_mm"])
    calm = [name for name, row in rows.items() if row["vibration_mm"] < limit]
    quiet = min(calm, key=lambda name: rows[name]["position_percent"])
    header = ["dither", "error left, position", "orientation", "window sum", "RMS along the path"]
    header += ["vibration [mm]", "at rest [mm]", "dither power [W]"]
    cells = [
        [
            name,
            *(percent(row[f"{error}_percent"]) for error in ERRORS),
            *(f"{row[key]:.3f}" for key in ("vibration_mm", "at_rest_mm")),
            f"{row['power_w']:.2f}",
        ]
        for name, row in rows.items()
    ]
    return {
        "quiet": quiet,
        "changes": [percent(row["position_percent"]) for row in (rows[quiet], thesis)],
        "added": [row["vibration_mm"] - plain["vibration_mm"] for row in (rows[quiet], thesis)],
        "plain": plain["vibration_mm"],
        "table": table_text(header, cells),
    }


def _draw_dither(rows: dict[str, dict[str, float]], path: Path) -> None:
    """Draw the error over that without dither, against vibration."""
    families: dict[str, list[dict[str, float]]] = {}
    for name, row in rows.items():
        families.setdefault(name.partition(" × ")[0], []).append(row)
    names = {
        "position": "error left 1 s after the last arrival (position)",
        "path": "RMS error along the path (all axes)",
    }
    figure = Figure(figsize=(12.6, 6.2), layout="constrained")
    for axes, (error, title) in zip(figure.subplots(1, 2, sharex=True), names.items(), strict=True):
        for k, (family, mine) in enumerate(families.items()):
            x = [row["vibration_mm"] for row in mine]
            y = [100 + row[f"{error}_percent"] for row in mine]
            line = "-" if 0 < k < 5 else ""
            axes.plot(
                x, y, "oo^sPvD*X<>"[k], color=f"C{k}" if k < 10 else "k", ls=line, label=family
            )
        axes.axhline(100, color="0.6", lw=0.8, ls=(0, (4, 3)), zorder=0)
        axes.set_title(title, loc="left", fontsize=10.5)
        axes.set_xlabel("vibration of the flange above 8 Hz [mm RMS]")
        axes.set_ylabel("error, no dither = 100 [%]")
        plain_axes(axes)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=8.5)
    save_full(figure, path)


# ---- does a learned policy shake better than a constant table, and than a rule? ------------------

BASELINE, BOUND = "Table 4.9", "no dither, 1 % of the friction"
"""Whom changes are over, and what is left by the controller's lag alone: dither, which takes
friction away at best, cannot do better."""
AIM = {"position": -35, "orientation": -40}
"""Changes of the error over Table 4.9 that are aimed at [%]; assumed."""
RANDOM, RAMPS = "random paths", ("torque", "oscillation")


class Estimate(NamedTuple):
    """A number and its bootstrap interval."""

    value: float
    low: float
    high: float


Found = dict[tuple[str, ...], Estimate]
"""Numbers with the known friction, by task, agent, measure and the agent that it is against."""


def agents(found: Found) -> list[str]:
    """Return the names of all agents on random paths."""
    return list(dict.fromkeys(agent for task, agent, *_ in found if task == RANDOM))


def policies(folder: Path) -> dict[str, Any]:
    """Draw the picture into a folder; return what the page's template asks for."""
    found: Found = {
        (row["task"], row["agent"], row["measure"], row["against"]): Estimate(
            *(float(row[k] or "nan") for k in ("value", "low", "high"))
        )
        for row in read("policies")
        if float(row["friction"]) == 1
    }
    lines, reached = [], []
    for agent in agents(found):
        measures = (*AIM, "moving", "at_rest")
        change = [found.get((RANDOM, agent, f"{x}_change_percent", BASELINE)) for x in measures]
        aims = zip(change, (*AIM.values(), 0, 0), strict=True)
        if agent != BOUND and all(x is not None and x.value <= aim for x, aim in aims):
            reached.append(agent)
        torque, oscillation = (found.get(("ramps", agent, x, "")) for x in RAMPS)
        cells = ["–" if x is None else signed(x.value, 0) for x in change]
        cells.append("–" if torque is None else number(torque.value, 2))
        lines.append([agent, *cells, "–" if oscillation is None else number(oscillation.value, 3)])
    header = ["agent", *(f"{x} error [%]" for x in AIM), "vibration moving [%]", "at rest [%]"]
    header += ["ramps: torque left", "oscillation [mrad]"]
    _draw_policies(folder / "policies.png", found)
    least = {name: -x for name, x in AIM.items()}
    return {"found": found, "table": table_text(header, lines), "reached": reached, "aim": least}


def _draw_policies(path: Path, found: Found) -> None:
    """Draw errors left against vibration on random paths."""
    figure = Figure(figsize=(12, 5), layout="constrained")
    both: Any = figure.subplots(1, 2)
    for axes, error in zip(both, AIM, strict=True):
        for k, agent in enumerate(agents(found)):
            x, y = (found[RANDOM, agent, name, ""] for name in ("moving", error))
            sides = ([[e.value - e.low], [e.high - e.value]] for e in (y, x))
            style = {"fmt": "osD^v<>pP*XhH"[k % 13], "color": f"C{k % 10}", "mfc": "none"}
            axes.errorbar(x.value, y.value, *sides, ms=9, label=agent, **style)
        axes.set_xlabel("vibration moving, over the undithered run's [1]")
        axes.set_ylabel(f"{error} error left, over the undithered run's [1]")
        axes.grid(alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), frameon=False, loc="outside right upper")
    figure.suptitle("Panda, random paths; interquartile means, 95 % intervals")
    save_full(figure, path)


# ---- what the search finds beyond the thesis's grid, and compensation without shaking ------------

SJE = "single joints"
"""Place of the rows of the Single Joint Experiment, where others have a path."""
LEFT = ("position", "orientation")
KNOWN = "friction known"
CONDITIONS = (KNOWN, "friction believed 30 % too small", "friction believed 30 % too large")
Numbers = dict[tuple[str, str, str], dict[str, dict[str, float]]]
"""Numbers by robot, condition and path, then by treatment and measure."""


def mean(found: Numbers, condition: str, treatment: str, name: str) -> float:
    """Return a number of the Panda, geometric mean over paths."""
    values = [found["panda", condition, path][treatment][name] for path in TRAJECTORIES]
    return float(np.exp(np.mean(np.log(values))))


def search(folder: Path) -> dict[str, Any]:
    """Draw the picture into a folder; return what the page's template asks for."""
    found: Numbers = {}
    for line in read("search"):
        *place, treatment, name, value = line.values()
        robot, condition, where = place
        rows = found.setdefault((robot, condition, where), {})
        rows.setdefault(treatment, {})[name] = float(value)
    _draw_search(found, folder / "compensation.png")

    def both(robot: str, condition: str, path: str, treatment: str, when: str = "") -> str:
        one = found[robot, condition, path][treatment]
        return " / ".join(f"{one[f'{when}{part}_percent']:.0f}" for part in LEFT)

    header = ["treatment"]
    for path in TRAJECTORIES:
        header += [f"{path}: over all goals", "at rest", "vibration at rest [mm]"]
    cells = []
    for name in found["panda", KNOWN, TRAJECTORIES[0]]:
        cells.append([name])
        for path in TRAJECTORIES:
            shaken = found["panda", KNOWN, path][name]["vibration_at_rest_mm"]
            cells[-1] += [both("panda", KNOWN, path, name, when) for when in ("", "resting_")]
            cells[-1].append(f"{shaken:.3f}")
    push = "push, searched"
    return {
        "settings": tuning_settings(),
        "table": table_text(header, cells),
        "push": [f"{mean(found, KNOWN, push, f'{part}_percent'):.0f}" for part in LEFT],
        "wrong": {
            condition: [both("panda", condition, path, push) for path in TRAJECTORIES]
            for condition in CONDITIONS
        },
        "joints": {
            robot: {
                table: f"{np.mean([x for k, x in one.items() if 'reduction' in k]):.1f}"
                for table, one in found[robot, KNOWN, SJE].items()
            }
            for robot in ROBOTS
        },
        "iiwas": {
            robot: [both(robot, KNOWN, path, "search, constant") for path in TRAJECTORIES]
            for robot in ROBOTS[1:]
        },
    }


def _draw_search(found: Numbers, path: Path) -> None:
    """Draw the Panda's error left against vibration at rest, a column per condition."""
    figure = Figure(figsize=(16, 8), layout="constrained")
    axes: Any = figure.subplots(2, len(CONDITIONS), sharey="row", sharex=True)
    for column, condition in enumerate(CONDITIONS):
        for axis, part in zip(axes[:, column], LEFT, strict=True):
            for k, name in enumerate(found["panda", condition, TRAJECTORIES[0]]):
                x, y = (
                    mean(found, condition, name, of)
                    for of in ("vibration_at_rest_mm", f"{part}_percent")
                )
                look: dict[str, Any] = {"marker": "osD^vP*X<h"[k], "mec": f"C{k}", "mfc": "none"}
                axis.plot(x, y, ls="", mew=2, ms=10, label=name, **look)
            axis.grid(alpha=0.3)
            if column == 0:
                axis.set_ylabel(f"{part} error left, of nothing [%]")
        axes[0, column].set_title(condition)
        axes[-1, column].set_xlabel("vibration at rest, rms [mm]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=9, loc="outside right upper")
    save_full(figure, path)


# ---- treatments of friction side by side: error left, vibration, rest and softness ---------------

SWING_MM = 1.0
"""A treatment that swings by more at rest hunts, and is not recommended; assumed."""
THIRD = 33
"""A third: share of each error that the best treatment is to leave at most [%]."""
DITHER = "dither"


def treatments(folder: Path) -> dict[str, Any]:
    """Draw the picture into a folder; return what the page's template asks for."""
    lines, searched = read("treatments"), read("treatments_searched")
    _draw_treatments(lines, folder / "treatments.png")
    winners = [line for line in lines if line["best"] == "1"]
    wins = Counter(line["treatment"] for line in winners).most_common()
    aims = Counter(
        line["robot"]
        for line in winners
        if max(float(line["position_percent"]), float(line["orientation_percent"])) <= THIRD
    )
    header = ["robot", "friction believed", "best with the model's gains", "left [%]", "both [%]"]
    header += ["best of all", "left [%]", "both [%]", "dither: left [%]"]
    rows = []
    for case in dict.fromkeys((x["robot"], x["believed_percent"]) for x in searched):
        mine = [x for x in searched if (x["robot"], x["believed_percent"]) == case]
        (usual,) = (x for x in mine if "default" in x["best"])
        (whole,) = (x for x in mine if "all" in x["best"])
        (dither,) = (x for x in mine if x["treatment"] == DITHER)
        wrong = f"{int(case[1]):+} %" if int(case[1]) else "known"
        rows.append([case[0], wrong, *_cells(usual), *_cells(whole), _cells(dither)[1]])
    return {
        "wins": [f"{name} in {count}" for name, count in wins],
        "dither_wins": dict(wins).get(DITHER, 0),
        "measured": len(winners),
        "aims": [f"{aims[robot]} of {len(winners) // 3} on the {robot}" for robot in ROBOTS],
        "table": table_text(header, rows),
        "needs": {name: law.knows for name, law in LAWS.items()},
        "margin_mm": 1e3 * tuning_settings().search.rest_margin,
        "swing_mm": SWING_MM,
    }


def _cells(line: Mapping[str, str]) -> list[str]:
    left = f"{line['position_percent']} / {line['orientation_percent']}"
    both = f"{line['both_percent']} ({line['low_percent']} to {line['high_percent']})"
    return [line["treatment"], left, both]


def _draw_treatments(lines: Lines, path: Path) -> None:
    """Draw error left against vibration of every treatment, a field per robot, 200 N/m, 1 ms late.

    Sizes of points are noise levels.
    """
    usual = {"stiffness_n_per_m": "200", "believed_percent": "0", "delay_ms": "1.0"}
    usual["load_kg"] = "0.0"
    shown = [line for line in lines if all(line[k] == x for k, x in usual.items())]
    figure = Figure(figsize=(14.8, 4.2), layout="constrained")
    for axes, robot in zip(figure.subplots(1, len(ROBOTS)), ROBOTS, strict=True):
        mine = [line for line in shown if line["robot"] == robot]
        for j, name in enumerate(dict.fromkeys(line["treatment"] for line in mine)):
            at = sorted((x for x in mine if x["treatment"] == name), key=lambda x: x["noise"])
            left = [
                np.array([float(x[f"{k}_percent"]) for x in at])
                for k in ("position", "orientation")
            ]
            axes.scatter(
                [float(x["vibration_at_rest_mm"]) for x in at],
                np.sqrt(left[0] * left[1]),
                s=[14 + 26 * i for i in range(len(at))],
                color=f"C{j % 10}",
                marker="os"[j // 10],
                label=name,
            )
        axes.set(title=robot, xlabel="vibration at rest [mm]", ylabel="error left at goals [%]")
        axes.axhline(THIRD, color="0.7", linewidth=1, zorder=0)
        axes.set(xlim=(0, None), ylim=(0, 130))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save_full(figure, path)


PAGES: dict[str, Callable[[Path], dict[str, Any]]] = {
    page.__name__: page for page in (dither_tradeoff, policies, search, treatments)
}
"""By name of the page and of its CSV, what draws its picture and returns its template's values."""


def main() -> None:
    options = STUDY.parser().parse_args()
    for name, page in PAGES.items():
        values = page(options.out)
        text = render(STUDY.folder / f"{name}.md.j2", command=STUDY.command, **values)
        (options.out / f"{name}.md").write_text(text.rstrip() + "\n", "utf-8")


if __name__ == "__main__":
    main()
