"""The studies behind the items: each is run once, for the parts that items ask for.

What is done is kept in ``studies/`` of the output folder, so that an interrupted run goes on:
torques in rows, paths in one file each. What takes seconds is done again.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Rows
from benchmarks.thesis.items import Found
from benchmarks.thesis.lsm import fit_lines, friction_curve
from benchmarks.thesis.torques import TUNED, choose
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, Measurement
from stiction_envs.measured import thesis_robots
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.version import __version__
from tuning.protocol.measurements import as_data, from_data

(ROBOT,) = thesis_robots("4.11")
ARRAYS = (
    *("time", "reference", "actual", "accepted", "reached", "mean_square"),
    *("dither_power", "torque_rate"),
)
"""Of a run on a path."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How studies are run."""

    seed: int = 0
    iterations: int | None = None
    """None for the thesis's."""
    scatter: bool = True
    threads: int = 0
    folder: Path
    """Of what is kept."""

    @property
    def arm(self) -> dict[str, Any]:
        """Arguments of an experiment."""
        return {"scatter": self.scatter, "seed": self.seed, "threads": self.threads}


def _curves(parts: Sequence[str], _: Found, how: Options) -> Iterator[tuple[Any, Any]]:
    for robot in parts:
        yield robot, friction_curve(robot, threads=how.threads)


def _lines(parts: Sequence[tuple[str, str]], _: Found, how: Options) -> Iterator[tuple[Any, Any]]:
    for robot, wrong in parts:
        yield (robot, wrong), fit_lines(robot, wrong, seed=how.seed)


def _torques(parts: Sequence[Any], _: Found, how: Options) -> Iterator[tuple[Any, Any]]:
    for robot in dict.fromkeys(robot for robot, _ in parts):
        # the folder's provenance has told this run from others already
        kept = Rows(how.folder / f"{robot}.jsonl", __version__)
        jobs = [job for other, job in parts if other == robot]
        missing = [j for j in jobs if str(j) not in kept]
        done = [j for j in jobs if str(j) in kept]
        measured = SingleJointExperiment(robot, **how.arm).run(missing, iterations=how.iterations)

        def keep(m: Measurement, kept: Rows = kept) -> Job:
            kept.add(str(m.job), as_data(m))
            return m.job

        for job in chain(done, map(keep, measured)):
            # as a resumed run reads them, so that both give the same page
            yield (robot, job), from_data(job, kept[str(job)])


def _choices(parts: Sequence[int], found: Found, _: Options) -> Iterator[tuple[Any, Any]]:
    measured = {job: m for (robot, job), m in found["sje"].items() if robot == TUNED}
    for joint in parts:
        yield joint, choose(joint, measured)


def _paths(parts: Sequence[Any], _: Found, how: Options) -> Iterator[tuple[Any, Any]]:
    """Yield runs and measures of each path and stiffness: without dither, and with the final."""
    arm = GeneratedTrajectoryExperiment(ROBOT, **how.arm)
    for trajectory, stiffness in parts:
        both = []
        for dither in ((), thesis_final_dither()):
            case = Case(trajectory=trajectory, stiffness=stiffness, dither=dither)
            kind = "dither" if dither else "no_dither"
            name = "_".join(f"{k:g}" for k in stiffness)
            file = how.folder / f"{trajectory}_{name}_{kind}.npz"
            if file.exists():
                run = _read(file, case)
            else:
                (run,) = arm.run([case], iterations=how.iterations)
                _keep(file, run)
            both.append((run, measure(run, arm.protocol, arm.motion)))
        yield (trajectory, stiffness), tuple(both)


def _keep(file: Path, run: Run) -> None:
    data = io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(run, name) for name in ARRAYS}
    arrays |= {f"flag_{name}": run.flags[name] for name in FLAGS}
    np.savez(data, **arrays)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(file, data.getvalue())


def _read(file: Path, case: Case) -> Run:
    with np.load(file) as data:
        flags = {name: data[f"flag_{name}"] for name in FLAGS}
        return Run(case=case, **{name: data[name] for name in ARRAYS}, flags=flags)


@dataclass(frozen=True)
class Study:
    """What items can ask for."""

    name: str
    """In the progress bar."""
    seconds: float
    """Of one processor for each part, measured roughly [s]."""
    run: Callable[[Sequence[Any], Found, Options], Iterator[tuple[Any, Any]]]
    """Parts, what earlier studies found, options → parts and what was found, as they are done."""


STUDIES = {
    "curve": Study("friction curve", 3.0, _curves),
    "lsm": Study("line fits", 1.5, _lines),
    "sje": Study("single joints", 0.7, _torques),
    "choice": Study("chosen settings", 0.0, _choices),
    "gte": Study("paths", 20.0, _paths),
}
"""By name, in the order in which they run: a later one may read what an earlier one found."""


def run_studies(
    needs: Mapping[str, Sequence[Any]], how: Options, tell: Callable[[str, float, float], None]
) -> tuple[Found, float]:
    """Run what is needed.

    Args:
        needs: parts by study.
        how: options of all.
        tell: called with what is being done, and the seconds done and of all studies.

    Returns:
        What was found by study and part, and the seconds of all studies.
    """
    parts = {name: needs[name] for name in STUDIES if name in needs}
    total, done = sum(STUDIES[name].seconds * len(mine) for name, mine in parts.items()), 0.0
    found: dict[str, dict[Any, Any]] = {}
    for name, mine in parts.items():
        study, found[name] = STUDIES[name], {}
        tell(study.name, done, total)
        for part, result in study.run(mine, found, how):
            found[name][part] = result
            done += study.seconds
            tell(study.name, done, total)
    return found, total
