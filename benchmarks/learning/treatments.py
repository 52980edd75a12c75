"""Treatments of friction side by side: error left, vibration, rest and softness on random paths.

    python -m benchmarks.learning.treatments

Writes the page and picture of ``treatments.csv`` and ``treatments_searched.csv``, whose rows were
measured once: the page says how.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.control.laws import LAWS
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from tuning.settings import tuning_settings

STUDY = Benchmark(__file__, __doc__)
ROBOTS = ("panda", "iiwa7", "iiwa14")
SWING_MM = 1.0
"""A treatment that swings by more at rest hunts, and is not recommended; assumed."""
AIM = 33
"""A third: share of each error that the best treatment is to leave at most [%]."""
DITHER = "dither"
Lines = list[dict[str, str]]
"""Rows of a CSV."""


def read_rows(path: Path) -> Lines:
    """Return the rows of a CSV."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def page(lines: Lines, searched: Lines) -> dict[str, Any]:
    """Return what the page's template asks for; rows of searched gains are shown as they are."""
    winners = [line for line in lines if line["best"] == "1"]
    wins = Counter(line["treatment"] for line in winners).most_common()
    aims = Counter(
        line["robot"]
        for line in winners
        if max(float(line["position_percent"]), float(line["orientation_percent"])) <= AIM
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


def draw(lines: Lines, path: Path) -> None:
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
        axes.axhline(AIM, color="0.7", linewidth=1, zorder=0)
        axes.set(xlim=(0, None), ylim=(0, 130))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save_full(figure, path)


def main() -> None:
    options = STUDY.parser().parse_args()
    lines, searched = (
        read_rows(STUDY.folder / f"{name}.csv") for name in ("treatments", "treatments_searched")
    )
    draw(lines, options.out / "treatments.png")
    STUDY.write_page(options, **page(lines, searched))


if __name__ == "__main__":
    main()
