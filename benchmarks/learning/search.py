"""What the search finds beyond the thesis's grid, and what compensation does without shaking.

    python -m benchmarks.learning.search

Writes the page and picture of ``search.csv``, whose rows were measured once: the page says how.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from tuning.search.verify import PATHS
from tuning.settings import tuning_settings

STUDY = Benchmark(__file__, __doc__)
ROBOTS = ("panda", "iiwa7", "iiwa14")
SJE = "single joints"
"""Place of the rows of the Single Joint Experiment, where others have a path."""
LEFT = ("position", "orientation")
KNOWN = "friction known"
CONDITIONS = (KNOWN, "friction believed 30 % too small", "friction believed 30 % too large")
Numbers = dict[tuple[str, str, str], dict[str, dict[str, float]]]
"""Numbers by robot, condition and path, then by treatment and measure."""


def read(path: Path) -> Numbers:
    """Return the numbers of the CSV."""
    out: Numbers = {}
    with path.open(encoding="utf-8") as file:
        for *place, treatment, name, value in list(csv.reader(file))[1:]:
            robot, condition, where = place
            rows = out.setdefault((robot, condition, where), {})
            rows.setdefault(treatment, {})[name] = float(value)
    return out


def mean(found: Numbers, condition: str, treatment: str, name: str) -> float:
    """Return a number of the Panda, geometric mean over paths."""
    values = [found["panda", condition, path][treatment][name] for path in PATHS]
    return float(np.exp(np.mean(np.log(values))))


def page(found: Numbers) -> dict[str, Any]:
    """Return what the page's template asks for."""

    def both(robot: str, condition: str, path: str, treatment: str, when: str = "") -> str:
        one = found[robot, condition, path][treatment]
        return " / ".join(f"{one[f'{when}{part}_percent']:.0f}" for part in LEFT)

    header = ["treatment"]
    for path in PATHS:
        header += [f"{path}: over all goals", "at rest", "vibration at rest [mm]"]
    rows = []
    for name in found["panda", KNOWN, PATHS[0]]:
        rows.append([name])
        for path in PATHS:
            shaken = found["panda", KNOWN, path][name]["vibration_at_rest_mm"]
            rows[-1] += [both("panda", KNOWN, path, name, when) for when in ("", "resting_")]
            rows[-1].append(f"{shaken:.3f}")
    push = "push, searched"
    return {
        "settings": tuning_settings(),
        "table": table_text(header, rows),
        "push": [f"{mean(found, KNOWN, push, f'{part}_percent'):.0f}" for part in LEFT],
        "wrong": {
            condition: [both("panda", condition, path, push) for path in PATHS]
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
            robot: [both(robot, KNOWN, path, "search, constant") for path in PATHS]
            for robot in ROBOTS[1:]
        },
    }


def draw(found: Numbers, path: Path) -> None:
    """Draw the Panda's error left against vibration at rest, a column per condition."""
    figure = Figure(figsize=(16, 8), layout="constrained")
    axes: Any = figure.subplots(2, len(CONDITIONS), sharey="row", sharex=True)
    for column, condition in enumerate(CONDITIONS):
        for axis, part in zip(axes[:, column], LEFT, strict=True):
            for k, name in enumerate(found["panda", condition, PATHS[0]]):
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


def main() -> None:
    options = STUDY.parser().parse_args()
    found = read(STUDY.folder / "search.csv")
    draw(found, options.out / "compensation.png")
    STUDY.write_page(options, **page(found))


if __name__ == "__main__":
    main()
