"""What the search finds beyond the thesis's grid, and what compensation does without shaking.

    python -m benchmarks.search [--work DIR] [--kept]

Searches the Panda's dither for the SJE and the GTE, gated and not, and its friction compensation,
alone and with dither, and the iiwas' dither; what was found goes to ``search/`` beside this file.
Then holds everything that is kept there against everything: on frictions that are known,
believed too small or too large, and from other poses. Stopped, it goes on: searches and rows are in
``--work``. Writes search.md and compensation.png. With ``--kept`` nothing is searched.
"""

from __future__ import annotations

import argparse
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks._search_page import write
from benchmarks._search_rows import (
    CONDITIONS,
    GAINS,
    ITERATIONS,
    KEPT,
    NOMINAL,
    SEED,
    WIDTHS,
    Rows,
    hunting,
    joints,
    paths,
    table_of,
)
from tuning.explore.search import search

HERE = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class Run:
    """One search."""

    robot: str = "panda"
    seed: int = 1
    options: Mapping[str, Any]
    """Of `tuning.explore.options.Options`."""
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
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("runs/benchmarks/search"))
    parser.add_argument("--kept", action="store_true", help="measure kept tables, search none")
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    if not asked.kept:
        found(asked.work)
    rows = Rows(asked.work / "rows.json")
    robots = tuple(dict.fromkeys(run.robot for run in RUNS.values()))
    write(
        HERE,
        paths={r: paths(r, rows, list(CONDITIONS) if r == "panda" else [NOMINAL]) for r in robots},
        joints={robot: joints(robot, rows) for robot in robots},
        hunting={f"{1e3 * w:g} mrad": x for w, x in zip(WIDTHS, hunting(rows), strict=True)},
        gains=GAINS,
        evaluations=RUNS["gated_1600"].options["evaluations"],
        gates_rad_s=[
            table_of(KEPT / kept)[0].gate_rad_s
            for name, run in RUNS.items()
            if name.startswith("gated_1600")
            for kept in run.kept.values()
        ],
        seed=SEED,
        iterations=ITERATIONS,
    )


if __name__ == "__main__":
    main()
