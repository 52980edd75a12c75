"""Episodes and trainings of `policies`: rows that are kept."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import EPISODES, PACKAGES, Row, Rows, code_digest
from benchmarks.learning.policies_plan import Cell, Contestant, Plan, Training, environment
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.method_settings import fingerprint
from stiction_envs.precomputed.store import digest
from stiction_envs.reporting.atomic import write_text_atomic
from tuning.policies.task import Task

SEED = 515_000
"""Of the first episode; no training has it."""
TOGETHER = 64
"""Arms at once; assumed."""
MEASURED_BY = (
    *(*EPISODES, "tuning/policies"),
    *(f"benchmarks/learning/policies_{name}.py" for name in ("plan", "run")),
)
"""Code that decides what an agent's episodes say; the agent itself is in `Contestant.made_of`."""
TRAINED_BY = (*EPISODES, "tuning/policies")
"""Code that decides the bits of a training; its settings are in the name of its folder."""


class Episodes:
    """Measured episodes of agents."""

    def __init__(self, work: Path, plan: Plan) -> None:
        """Open the rows of a folder."""
        code = code_digest(MEASURED_BY, (*PACKAGES, "gymnasium"))
        self._rows, self._plan = Rows(work / "episodes.jsonl", code), plan

    def key(self, cell: Cell, one: Contestant) -> str:
        """Return the key of an agent's row: all that it depends on besides code."""
        where = (cell.robot, cell.experiment, cell.task, cell.friction)
        options = [dict(o) for o in cell.options]
        made_of = (dict(_task(cell, one).arguments), options, one.made_of, self.runs(one))
        return f"{cell.robot} {cell.task} {cell.friction:g} {one.name} {digest(*where, *made_of)}"

    def runs(self, one: Contestant) -> list[int]:
        """Return the runs that an agent has."""
        return list(range(self._plan.runs)) if one.run is None else [one.run]

    def measure(self, todo: Sequence[tuple[Cell, Contestant]], minutes: float) -> int:
        """Measure what is missing of agents' episodes; return how many agents are still missing."""
        jobs = {self.key(*one): one for one in todo}
        return len(jobs) - len(self._rows.fill(jobs, self._measured, minutes=minutes))

    def _measured(self, job: tuple[Cell, Contestant]) -> Row:
        cell, one = job
        each = [(run, k) for run in self.runs(one) for k in range(len(cell.options))]
        env = _task(cell, one).make(min(TOGETHER, len(each)))
        if one.compensation is not None:
            compensate(env, one.compensation)
        seeds = [SEED + 1000 * run + k for run, k in each]
        rows = evaluate(env, one.make(env), seeds, [cell.options[k] for _, k in each])
        env.close()
        return {"episodes": rows}

    def read(self, cell: Cell, one: Contestant) -> list[Row]:
        """Return the episodes of an agent."""
        out: list[Row] = self._rows[self.key(cell, one)]["episodes"]
        return out

    def seconds(self, cell: Cell, one: Contestant) -> float:
        """Return what measuring an agent's episodes took [s]."""
        return float(self._rows[self.key(cell, one)]["seconds"])


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


# ---- trainings -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trained:
    """A training that is over."""

    training: Training
    policy: Path
    """What was trained."""
    code: str
    """Digest of the code that trained it."""
    steps_per_second: float | None
    """Of its last process; None where that had nothing left to do."""
    curve: NDArray[np.float64]
    """(2, evaluations) steps, and the returns of their evaluations."""


def folder(work: Path, plan: Plan, training: Training) -> Path:
    """Return the folder of a training; other settings have another one."""
    arguments = {k: repr(v) for k, v in training.task.arguments.items()}
    settings = training.settings
    used = {"own": getattr(settings, training.algorithm), "run": settings.run}
    start = [repr(row) for row in training.start]
    begun = [start, fingerprint(settings.start)] if start else []
    of = digest(training.name, plan.steps, arguments, fingerprint(used), *begun)
    return work / "trainings" / f"{training.name}-{of[:8]}"


def train_all(
    work: Path, plan: Plan, wanted: Sequence[Training], minutes: float
) -> dict[Training, Trained]:
    """Train what is not done, two at a time; return the trainings that are over.

    What was finished by other code stays, and says so: a policy is what it is, however it came
    about. What was only begun by other code is begun anew; else it goes on from its checkpoint.
    """
    paths = {t: folder(work, plan, t) for t in wanted}
    jobs = {path.name: (t, plan.steps, path) for t, path in paths.items()}
    kept = Rows(work / "trainings.jsonl", "")
    rows = kept.fill(jobs, train_one, processes=2, minutes=minutes)
    return {
        t: Trained(
            t,
            path / "policy.zip",
            row["code"],
            row["steps_per_second"],
            np.array(row["curve"]),
        )
        for t, path in paths.items()
        if (row := rows.get(path.name)) is not None
    }


def train_one(job: tuple[Training, int, Path]) -> Row:
    """Train one policy in its folder."""
    from tuning.policies.train import CHECKPOINTS, train

    training, steps, path = job
    path.mkdir(parents=True, exist_ok=True)
    code, made_by = code_today(), path / "code"
    if not made_by.exists() or made_by.read_text("utf-8") != code:
        shutil.rmtree(path / CHECKPOINTS, ignore_errors=True)
        write_text_atomic(made_by, code)
    found = train(
        training.task,
        training.algorithm,
        steps=steps,
        out=path,
        seed=training.run,
        start=training.start,
        settings=training.settings,
    )
    table = np.genfromtxt(path / "curve.csv", delimiter=",", names=True)
    curve = [np.atleast_1d(table[x]).tolist() for x in ("steps", "evaluation_return")]
    return {"code": code, "steps_per_second": found.steps_per_second, "curve": curve}


@cache
def code_today() -> str:
    """Return a digest of the code that trains today."""
    return code_digest(TRAINED_BY, (*PACKAGES, "stable-baselines3", "torch", "gymnasium"))


def best_algorithm(trained: Mapping[Training, Trained], wanted: Sequence[Training]) -> str | None:
    """Return whose kept policies had the best evaluations while the Panda's GTE was trained.

    These episodes are on paths that training knows: none of the test's has a say. None while a
    training is missing.
    """
    returns: dict[str, list[float]] = {}
    for t in wanted:
        if (t.robot, t.experiment) == ("panda", "gte"):
            if t not in trained:
                return None
            returns.setdefault(t.algorithm, []).append(float(trained[t].curve[1].max()))
    return max(returns, key=lambda algorithm: float(np.mean(returns[algorithm])))
