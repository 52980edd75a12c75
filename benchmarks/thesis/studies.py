"""The studies behind the items: each is run once, for the parts that items ask for.

What is done is kept in ``studies/`` of the output folder, so that an interrupted run goes on:
torques and set-ups in rows, paths in one file each. What takes seconds is done again.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Rows
from benchmarks.thesis.ensemble import runs as ensemble
from benchmarks.thesis.ensemble.set_ups import ROBOT, prior
from benchmarks.thesis.items import Found
from benchmarks.thesis.lsm import fit_lines, friction_curve
from benchmarks.thesis.torques import TUNED, choose
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.version import __version__
from tuning.protocol.measurements import as_data, from_data

Advance = Callable[[float], None]
"""Called with the seconds of one processor that were worked off, roughly."""
COST = {"curve": 3.0, "lsm": 1.5, "arm": 0.005, "path": 0.03, "set-up": 5.0, "drawing": 0.4}
"""Measured seconds of one processor: of a curve, a log, a simulated second of an arm and of a path,
a set-up, a figure."""
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


@dataclass(frozen=True)
class Study:
    """What items can ask for."""

    name: str
    """In the progress bar."""
    run: Callable[[Sequence[Any], Found, Options, Advance], dict[Any, Any]]
    """Parts, what earlier studies found, how, progress → by part."""
    cost: Callable[[Sequence[Any], Options], float]
    """Seconds of one processor, roughly."""


def _curves(parts: Sequence[str], _: Found, how: Options, advance: Advance) -> dict[Any, Any]:
    out = {}
    for robot in parts:
        out[robot] = friction_curve(robot, threads=how.threads)
        advance(COST["curve"])
    return out


def _lines(
    parts: Sequence[tuple[str, str]], _: Found, how: Options, advance: Advance
) -> dict[Any, Any]:
    out = {}
    for robot, wrong in parts:
        out[robot, wrong] = fit_lines(robot, wrong, seed=how.seed)
        advance(COST["lsm"])
    return out


# ---- Single Joint Experiment ---------------------------------------------------------------------


def _by_robot(parts: Sequence[tuple[str, Job]]) -> dict[str, list[Job]]:
    robots = dict.fromkeys(robot for robot, _ in parts)
    return {robot: [job for other, job in parts if other == robot] for robot in robots}


def _arm(robot: str, how: Options) -> SingleJointExperiment:
    return SingleJointExperiment(robot, scatter=how.scatter, seed=how.seed, threads=how.threads)


def _torques(
    parts: Sequence[tuple[str, Job]], _: Found, how: Options, advance: Advance
) -> dict[Any, Any]:
    out = {}
    for robot, jobs in _by_robot(parts).items():
        # the folder's provenance has told this run from others already
        kept, arm = Rows(how.folder / f"{robot}.jsonl", __version__), _arm(robot, how)
        missing = [j for j in jobs if str(j) not in kept]
        done = [j for j in jobs if str(j) in kept]
        advance(COST["arm"] * arm.expected_seconds(done, how.iterations))

        def progress(seconds: float) -> None:
            advance(COST["arm"] * seconds)

        for m in arm.run(missing, iterations=how.iterations, progress=progress):
            kept.add(str(m.job), as_data(m))
        # as a resumed run reads them, so that both give the same page
        out.update({(robot, j): from_data(j, kept[str(j)]) for j in jobs})
    return out


def _torque_cost(parts: Sequence[tuple[str, Job]], how: Options) -> float:
    seconds = [
        _arm(robot, how).expected_seconds(jobs, how.iterations)
        for robot, jobs in _by_robot(parts).items()
    ]
    return COST["arm"] * sum(seconds)


def _choices(parts: Sequence[int], found: Found, _: Options, __: Advance) -> dict[Any, Any]:
    measured = {job: m for (robot, job), m in found["sje"].items() if robot == TUNED}
    return {joint: choose(joint, measured) for joint in parts}


# ---- Generated Trajectory Experiment -------------------------------------------------------------


def _cases(parts: Sequence[Any]) -> list[Case]:
    return [
        Case(trajectory=trajectory, stiffness=stiffness, dither=d)
        for trajectory, stiffness in parts
        for d in ((), thesis_final_dither())
    ]


def _path_arm(how: Options) -> GeneratedTrajectoryExperiment:
    return GeneratedTrajectoryExperiment(
        ROBOT, scatter=how.scatter, seed=how.seed, threads=how.threads
    )


def _paths(parts: Sequence[Any], _: Found, how: Options, advance: Advance) -> dict[Any, Any]:
    arm, done = _path_arm(how), []

    def progress(seconds: float) -> None:
        advance(COST["path"] * seconds)

    for case in _cases(parts):
        kind = "dither" if case.dithered else "no_dither"
        stiffness = "_".join(f"{k:g}" for k in case.stiffness)
        file = how.folder / f"{case.trajectory}_{stiffness}_{kind}.npz"
        if file.exists():
            run = _read(file, case)
            progress(arm.expected_seconds([case], how.iterations))
        else:
            (run,) = arm.run([case], iterations=how.iterations, progress=progress)
            _keep(file, run)
        done.append((run, measure(run, arm.protocol, arm.motion)))
    return dict(zip(parts, zip(done[::2], done[1::2], strict=True), strict=True))


def _path_cost(parts: Sequence[Any], how: Options) -> float:
    return COST["path"] * _path_arm(how).expected_seconds(_cases(parts), how.iterations)


def _keep(file: Path, run: Run) -> None:
    data = io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(run, name) for name in ARRAYS}
    np.savez(data, **arrays, **{f"flag_{name}": run.flags[name] for name in FLAGS})
    file.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(file, data.getvalue())


def _read(file: Path, case: Case) -> Run:
    with np.load(file) as data:
        flags = {name: data[f"flag_{name}"] for name in FLAGS}
        return Run(case=case, **{name: data[name] for name in ARRAYS}, flags=flags)


def _ensemble(parts: Sequence[str], _: Found, how: Options, advance: Advance) -> dict[Any, Any]:
    """Run set-ups that the thesis leaves open; and what is lag in the shipped one."""
    before = 0

    def progress(done: int, _: int) -> None:
        nonlocal before
        advance(COST["set-up"] * (done - before))
        before = done

    same: Mapping[str, Any] = {"seed": how.seed, "scatter": how.scatter, "threads": how.threads}
    members = ensemble.run_ensemble(how.folder / "ensemble.jsonl", progress=progress, **same)
    return dict.fromkeys(parts, (members, ensemble.shipped_lag(**same)))


STUDIES = {
    "curve": Study("friction curve", _curves, lambda parts, _: COST["curve"] * len(parts)),
    "lsm": Study("line fits", _lines, lambda parts, _: COST["lsm"] * len(parts)),
    "sje": Study("single joints", _torques, _torque_cost),
    "choice": Study("chosen settings", _choices, lambda *_: 0.0),
    "gte": Study("paths", _paths, _path_cost),
    "ensemble": Study(
        "set-ups of the paths", _ensemble, lambda *_: COST["set-up"] * prior()["run"]["set_ups"]
    ),
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
    costs = {name: STUDIES[name].cost(mine, how) for name, mine in parts.items()}
    total, before = sum(costs.values()), 0.0
    found: dict[str, dict[Any, Any]] = {}
    for name, mine in parts.items():
        study, done = STUDIES[name], 0.0

        def advance(
            seconds: float, study: Study = study, most: float = costs[name], start: float = before
        ) -> None:
            nonlocal done
            done += seconds
            # estimates may be passed; the next study starts where this one was to end
            tell(study.name, start + min(done, most), total)

        tell(study.name, before, total)
        found[name] = study.run(mine, found, how, advance)
        before += costs[name]
    return found, total
