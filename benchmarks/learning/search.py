"""What the search finds beyond the thesis's grid, and what compensation does without shaking.

    python -m benchmarks.learning.search [--kept]

Searches the Panda's dither for the SJE and the GTE, gated and not, and its friction compensation,
alone and with dither, and the iiwas' dither; the results go to ``search/`` beside this file. Then
compares everything that is kept there: with friction that is known, believed too small or too
large, and from other poses. With ``--kept`` nothing is searched.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.harness import Benchmark
from benchmarks.learning.search_page import draw, page
from benchmarks.learning.search_rows import (
    CONDITIONS,
    GAINS,
    ITERATIONS,
    KEPT,
    MEASURED_BY,
    NOMINAL,
    SEED,
    WIDTHS,
    hunting,
    joints,
    paths,
    table_of,
)
from tuning.search.search import search

STUDY = Benchmark(__file__, __doc__, made_by=MEASURED_BY)


@dataclass(frozen=True, kw_only=True)
class Run:
    """One search."""

    robot: str = "panda"
    seed: int = 1
    options: Mapping[str, Any]
    """Of `tuning.search.options.Options`."""
    kept: Mapping[str, str]
    """Files that are kept of it: name in its folder, name in ``search/``."""


def _both(robot: str) -> Run:
    kept = {"final.csv": f"{robot}_gte.csv", "sje_table.csv": f"{robot}_sje.csv"}
    return Run(robot=robot, options={"objective": "both"}, kept=kept)


def _compensation(kind: str, name: str, *, dither: bool = False) -> Run:
    options = {"objective": "gte", "compensation": kind, "without_dither": not dither}
    kept = {"compensation.csv": f"panda_{name}_gains.csv"}
    if dither:
        kept["final.csv"] = f"panda_gte_{name}.csv"
    return Run(options=options, kept=kept)


def _longer(seed: int, kept: str) -> Run:
    options = {"objective": "gte", "gates": "one", "evaluations": 1600}
    return Run(seed=seed, options=options, kept={"final.csv": f"{kept}.csv"})


RUNS = {
    "both": _both("panda"),
    "gated": Run(
        options={"objective": "gte", "gates": "each"}, kept={"final.csv": "panda_gte_gated.csv"}
    ),
    "gated_1600": _longer(0, "panda_gte_gated_1600"),
    "gated_1600_seed1": _longer(1, "panda_gte_gated_1600_seed1"),
    "feedforward": _compensation("feedforward", "feedforward"),
    "push": _compensation("push", "push"),
    "push_and_dither": _compensation("push", "push_dither", dither=True),
    "iiwa7": _both("iiwa7"),
    "iiwa14": _both("iiwa14"),
}
"""Searches by their folders in ``--work``."""


def found(work: Path) -> None:
    """Run the searches that are not done yet; keep what they found."""
    KEPT.mkdir(exist_ok=True)
    for name, run in RUNS.items():
        print(name, flush=True)
        search(run.robot, out=work / name, seed=run.seed, progress=_say, **run.options)
        print(flush=True)
        for one, kept in run.kept.items():
            shutil.copy(work / name / one, KEPT / kept)


def _say(stage: str, done: float, total: float) -> None:
    print(f"\r{stage} {done:.0f}/{total:.0f}   ", end="", flush=True)


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--kept", action="store_true", help="measure kept tables, search none")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = STUDY.rows(options)
    if not options.kept:
        found(options.work)
    robots = tuple(dict.fromkeys(run.robot for run in RUNS.values()))
    measured = {r: paths(r, rows, list(CONDITIONS) if r == "panda" else [NOMINAL]) for r in robots}
    longest = [name for name in RUNS if name.startswith("gated_1600")]
    gates = [table_of(KEPT / x)[0].gate_rad_s for n in longest for x in RUNS[n].kept.values()]
    STUDY.write_page(
        options,
        seed=SEED,
        iterations=ITERATIONS,
        evaluations=RUNS["gated_1600"].options["evaluations"],
        gates_rad_s=gates,
        **page(
            paths=measured,
            joints={robot: joints(robot, rows) for robot in robots},
            hunting={f"{1e3 * w:g} mrad": x for w, x in zip(WIDTHS, hunting(rows), strict=True)},
            gains=GAINS,
        ),
    )
    draw(measured["panda"], options.out / "compensation.png")


if __name__ == "__main__":
    main()
