"""Does a learned policy shake better than a constant table, and than a rule?

    python -m benchmarks.learning.policies

Writes the page and picture of ``policies.csv``, whose rows were measured once: the page says how.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from benchmarks.harness import Benchmark
from stiction_envs.reporting.markdown import number, signed, table_text
from stiction_envs.reporting.png import save_full

STUDY = Benchmark(__file__, __doc__)
ROWS = STUDY.folder / "policies.csv"
BASELINE, BOUND = "Table 4.9", "no dither, 1 % of the friction"
"""Whom changes are over, and what is left by the controller's lag alone: dither, which takes
friction away at best, cannot do better."""
AIM = {"position": -35, "orientation": -40}
"""Changes of the error over Table 4.9 that are aimed at [%]; assumed."""
PATHS, RAMPS = "random paths", ("torque", "oscillation")


class Estimate(NamedTuple):
    """A number and its bootstrap interval."""

    value: float
    low: float
    high: float


Found = dict[tuple[str, ...], Estimate]
"""Numbers with the known friction, by task, agent, measure and the agent that it is against."""


def read(path: Path) -> Found:
    """Return the rows of ``policies.csv``."""
    out = {}
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if float(row["friction"]) == 1:
                names = (row[k] for k in ("task", "agent", "measure", "against"))
                value, low, high = (float(row[k] or "nan") for k in ("value", "low", "high"))
                out[tuple(names)] = Estimate(value, low, high)
    return out


def agents(found: Found) -> list[str]:
    """Return the names of all agents on random paths."""
    return list(dict.fromkeys(agent for task, agent, *_ in found if task == PATHS))


def page(rows: Path, folder: Path) -> dict[str, Any]:
    """Draw the picture into a folder; return what the page's template asks for."""
    found = read(rows)
    lines, reached = [], []
    for agent in agents(found):
        measures = (*AIM, "moving", "at_rest")
        change = [found.get((PATHS, agent, f"{x}_change_percent", BASELINE)) for x in measures]
        aims = zip(change, (*AIM.values(), 0, 0), strict=True)
        if agent != BOUND and all(x is not None and x.value <= aim for x, aim in aims):
            reached.append(agent)
        torque, oscillation = (found.get(("ramps", agent, x, "")) for x in RAMPS)
        cells = ["–" if x is None else signed(x.value, 0) for x in change]
        cells.append("–" if torque is None else number(torque.value, 2))
        lines.append([agent, *cells, "–" if oscillation is None else number(oscillation.value, 3)])
    header = ["agent", *(f"{x} error [%]" for x in AIM), "vibration moving [%]", "at rest [%]"]
    header += ["ramps: torque left", "oscillation [mrad]"]
    _draw(folder / "policies.png", found)
    least = {name: -x for name, x in AIM.items()}
    return {"found": found, "table": table_text(header, lines), "reached": reached, "aim": least}


def _draw(path: Path, found: Found) -> None:
    """Draw errors left against vibration on random paths."""
    figure = Figure(figsize=(12, 5), layout="constrained")
    both: Any = figure.subplots(1, 2)
    for axes, error in zip(both, AIM, strict=True):
        for k, agent in enumerate(agents(found)):
            x, y = (found[PATHS, agent, name, ""] for name in ("moving", error))
            sides = ([[e.value - e.low], [e.high - e.value]] for e in (y, x))
            style = {"fmt": "osD^v<>pP*XhH"[k % 13], "color": f"C{k % 10}", "mfc": "none"}
            axes.errorbar(x.value, y.value, *sides, ms=9, label=agent, **style)
        axes.set_xlabel("vibration moving, over the undithered run's [1]")
        axes.set_ylabel(f"{error} error left, over the undithered run's [1]")
        axes.grid(alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), frameon=False, loc="outside right upper")
    figure.suptitle("Panda, random paths; interquartile means, 95 % intervals")
    save_full(figure, path)


def main() -> None:
    options = STUDY.parser().parse_args()
    STUDY.write_page(options, **page(ROWS, options.out))


if __name__ == "__main__":
    main()
