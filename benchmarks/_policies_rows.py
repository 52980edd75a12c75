"""Measured episodes of `policies`: a file for each agent and cell, which is there or is not."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks._made_by import EPISODES, PACKAGES, made_by
from benchmarks._policies_measures import MEASURES, Row
from benchmarks._policies_plan import Cell, Contestant, Plan, environment
from benchmarks._policies_statistics import worst_for_missing
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.atomic import write_text_atomic
from tuning.policies.task import Task

SEED = 515_000
"""Of the first episode; no training has it."""
TOGETHER = 64
"""Arms at once."""
MEASURED_BY = (
    *EPISODES,
    *(f"tuning/policies/{name}.py" for name in ("archive", "evaluation", "policy", "task")),
    *(f"benchmarks/_policies_{name}.py" for name in ("plan", "rows")),
)
"""Code that decides what an agent's episodes say; the agent itself is in `Contestant.made_of`."""


class Rows:
    """Rows of agents, in files whose names are hashes of all that they depend on."""

    def __init__(self, folder: Path, plan: Plan) -> None:
        """Open a folder, which need not exist."""
        self._folder, self._plan = folder, plan
        folder.mkdir(parents=True, exist_ok=True)

    def path(self, cell: Cell, one: Contestant) -> Path:
        """Return the file of an agent's episodes."""
        where = (cell.robot, cell.experiment, cell.task, cell.friction)
        arguments = dict(_task(cell, one).arguments)
        of = digest(
            code_today(),
            *where,
            arguments,
            [dict(o) for o in cell.options],
            one.made_of,
            self.runs(one),
        )
        words = [*where[:3], f"{cell.friction:g}", one.name]
        name = "-".join("".join(c for c in str(w) if c.isalnum() or c == ".") for w in words)
        return self._folder / f"{name}-{of[:16]}.json"

    def runs(self, one: Contestant) -> list[int]:
        """Return the runs that an agent has."""
        return list(range(self._plan.runs)) if one.run is None else [one.run]

    def episodes(self, cell: Cell, one: Contestant) -> int:
        """Return how many episodes are measured."""
        return len(self.runs(one)) * len(cell.options)

    def measure(self, cell: Cell, one: Contestant) -> None:
        """Measure an agent's episodes, unless they are there."""
        path = self.path(cell, one)
        if path.exists():
            return
        seeds, options = [], []
        for run in self.runs(one):
            for k, o in enumerate(cell.options):
                seeds.append(SEED + 1000 * run + k)
                options.append(o)

        start = time.perf_counter()
        env = _task(cell, one).make(min(TOGETHER, len(seeds)))
        if one.compensation is not None:
            compensate(env, one.compensation)
        rows = evaluate(env, one.make(env), seeds, options)
        env.close()
        seconds = time.perf_counter() - start
        write_text_atomic(path, json.dumps({"seconds": seconds, "rows": rows}))

    def scores(self, cell: Cell, ones: Sequence[Contestant], key: str) -> NDArray[np.float64]:
        """Return a measure (runs, tasks) of an agent, or of one agent for each run.

        What an episode does not have is infinitely bad; lower is better, of the return too, whose
        sign is turned.
        """
        of = MEASURES[cell.experiment][key]
        rows = [row for one in ones for row in self.read(cell, one)]
        values = [of.sign * of.value(row) for row in rows]
        return worst_for_missing(np.array(values, dtype=float).reshape(-1, len(cell.options)))

    def read(self, cell: Cell, one: Contestant) -> list[Row]:
        """Return the measured rows."""
        rows: list[Row] = self._read(cell, one)["rows"]
        return rows

    def seconds(self, cell: Cell, one: Contestant) -> float:
        """Return what measuring an agent's episodes took [s]."""
        return float(self._read(cell, one)["seconds"])

    def _read(self, cell: Cell, one: Contestant) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.path(cell, one).read_text("utf-8"))
        return found

    def there(self, cell: Cell, one: Contestant) -> bool:
        """Whether an agent's episodes were measured."""
        return self.path(cell, one).exists()


@cache
def code_today() -> str:
    """Return a hash of the code that measures today."""
    return made_by(MEASURED_BY, (*PACKAGES, "gymnasium"))


def _task(cell: Cell, one: Contestant) -> Task:
    true = cell.friction * one.friction
    return environment(cell.robot, cell.experiment, friction_factor=true)


def compensate(env: Any, compensation: Any) -> None:
    """Compensate the friction of all arms of a batch.

    As the environment's argument ``compensation`` does, but for the undithered runs, which remain
    those without: all agents are measured with one yardstick.
    """
    for core in env.tiles.cores:
        core.rig.compensator.set_rows(np.arange(core.num_envs), [compensation] * core.num_envs)
