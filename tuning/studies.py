"""The studies behind `stiction reproduce`: each is run once, for the parts that items ask for.

Finished parts are kept in ``studies/`` of the output folder, so that an interrupted run goes on:
torques in lab books (`tuning.labbook`), paths in one file each. What takes seconds is done again.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.robots import load_arm
from stiction_envs.thesis.ensemble import run_ensemble, shipped_lag
from stiction_envs.thesis.ensemble_settings import ensemble_settings
from stiction_envs.thesis.friction_curve import friction_curve
from stiction_envs.thesis.gte import ROBOT
from stiction_envs.thesis.lsm import fit_lines
from stiction_envs.thesis.settings import thesis_settings
from stiction_envs.thesis.tables import TUNED, choices
from stiction_envs.version import __version__
from tuning.labbook import LabBook
from tuning.rules import final_amplitude

FOLDER = "studies"
Advance = Callable[[float], None]
"""Called with the seconds of one processor that were worked off, roughly."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How studies are run."""

    seed: int
    iterations: int | None
    scatter: bool
    nthread: int
    folder: Path


Found = Mapping[str, Mapping[Any, Any]]


@dataclass(frozen=True)
class Study:
    """What items can ask for."""

    run: Callable[[Sequence[Any], Found, Setting, Advance], dict[Any, Any]]
    """Parts, what earlier studies found, how, progress → by part."""
    cost: Callable[[Sequence[Any], Setting], float]
    """Seconds of one processor, roughly."""


def _curves(parts: Sequence[str], _: Found, how: Setting, advance: Advance) -> dict[Any, Any]:
    out = {}
    for robot in parts:
        out[robot] = friction_curve(robot, nthread=how.nthread)
        advance(thesis_settings().cost.curve)
    return out


def _lines(
    parts: Sequence[tuple[str, str]], _: Found, how: Setting, advance: Advance
) -> dict[Any, Any]:
    out = {}
    for robot, wrong in parts:
        out[robot, wrong] = fit_lines(robot, wrong, seed=how.seed)
        advance(thesis_settings().cost.fit)
    return out


# ---- Single Joint Experiment ---------------------------------------------------------------------


def _bench(robot: str, how: Setting) -> SingleJointExperiment:
    return SingleJointExperiment(robot, scatter=how.scatter, seed=how.seed, nthread=how.nthread)


def _torques(parts: Sequence[Any], _: Found, how: Setting, advance: Advance) -> dict[Any, Any]:
    rate = thesis_settings().cost.simulated_arm
    out = {}
    for robot in dict.fromkeys(robot for robot, _ in parts):
        jobs = [job for other, job in parts if other == robot]
        # the folder's provenance has told this run from others already
        book = LabBook(how.folder / f"{robot}.jsonl", {"robot": robot, "version": __version__})
        bench = _bench(robot, how)
        done = [j for j in jobs if book.get("thesis", j) is not None]
        advance(rate * bench.expected_seconds(done, how.iterations))
        measured = book.measure(
            "thesis",
            bench,
            jobs,
            iterations=how.iterations,
            progress=lambda seconds: advance(rate * seconds),
        )
        out.update({(robot, job): m for job, m in measured.items()})
    return out


def _torque_cost(parts: Sequence[Any], how: Setting) -> float:
    total = 0.0
    for robot in dict.fromkeys(robot for robot, _ in parts):
        jobs = [job for other, job in parts if other == robot]
        total += _bench(robot, how).expected_seconds(jobs, how.iterations)
    return total * thesis_settings().cost.simulated_arm


def _choices(parts: Sequence[int], found: Found, _: Setting, __: Advance) -> dict[Any, Any]:
    """Apply the thesis's rules to the simulated torques (Table 4.9)."""
    measured = {job: m for (robot, job), m in found["sje"].items() if robot == TUNED}
    chosen = choices(measured, final_amplitude, load_arm(TUNED).limits.torque_rate)
    return {c.joint: c for c in chosen if c.joint in parts}


# ---- Generated Trajectory Experiment -------------------------------------------------------------

_ARRAYS = (
    *("time", "reference", "actual", "accepted", "reached", "mean_square"),
    *("dither_power", "torque_rate"),
)


def _cases(parts: Sequence[Any]) -> list[Case]:
    dither = thesis_final_dither()
    return [
        Case(trajectory=trajectory, stiffness=stiffness, dither=d)
        for trajectory, stiffness in parts
        for d in ((), dither)
    ]


def _path_bench(how: Setting) -> GeneratedTrajectoryExperiment:
    return GeneratedTrajectoryExperiment(
        ROBOT, scatter=how.scatter, seed=how.seed, nthread=how.nthread
    )


def _paths(parts: Sequence[Any], _: Found, how: Setting, advance: Advance) -> dict[Any, Any]:
    rate = thesis_settings().cost.simulated_path
    bench = _path_bench(how)
    out = {}
    for part in parts:
        pair = []
        for case in _cases([part]):
            kind = "dither" if case.dithered else "no_dither"
            stiffness = "_".join(f"{k:g}" for k in case.stiffness)
            file = how.folder / f"{case.trajectory}_{stiffness}_{kind}.npz"
            if file.exists():
                run = _read(file, case)
                advance(rate * bench.expected_seconds([case], how.iterations))
            else:
                (run,) = bench.run(
                    [case],
                    iterations=how.iterations,
                    progress=lambda seconds: advance(rate * seconds),
                )
                _keep(file, run)
            pair.append((run, measure(run, bench.protocol, bench.motion)))
        out[part] = tuple(pair)
    return out


def _path_cost(parts: Sequence[Any], how: Setting) -> float:
    seconds = _path_bench(how).expected_seconds(_cases(parts), how.iterations)
    return seconds * thesis_settings().cost.simulated_path


def _keep(file: Path, run: Run) -> None:
    data = io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(run, name) for name in _ARRAYS}
    arrays.update({f"flag_{name}": run.flags[name] for name in FLAGS})
    np.savez(data, **arrays)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(file, data.getvalue())


def _read(file: Path, case: Case) -> Run:
    with np.load(file) as data:
        return Run(
            case=case,
            **{name: data[name] for name in _ARRAYS},
            flags={name: data[f"flag_{name}"] for name in FLAGS},
        )


def _ensemble(parts: Sequence[str], _: Found, how: Setting, advance: Advance) -> dict[Any, Any]:
    """Run set-ups that the thesis leaves open; and what is lag in the shipped one."""
    settings, each = ensemble_settings(), thesis_settings().cost.set_up
    told = 0

    def count(done: int, _: int) -> None:
        nonlocal told
        advance(each * (done - told))
        told = done

    how.folder.mkdir(parents=True, exist_ok=True)
    common: dict[str, Any] = {"seed": how.seed, "scatter": how.scatter, "nthread": how.nthread}
    file = how.folder / "ensemble.jsonl"
    members = run_ensemble(file, settings=settings, progress=count, **common)
    found = members, shipped_lag(settings, **common)
    return dict.fromkeys(parts, found)


STUDIES: dict[str, Study] = {
    "curve": Study(_curves, lambda parts, _: len(parts) * thesis_settings().cost.curve),
    "lsm": Study(_lines, lambda parts, _: len(parts) * thesis_settings().cost.fit),
    "sje": Study(_torques, _torque_cost),
    "choice": Study(_choices, lambda *_: 0.0),
    "gte": Study(_paths, _path_cost),
    "ensemble": Study(
        _ensemble, lambda *_: ensemble_settings().run.set_ups * thesis_settings().cost.set_up
    ),
}
"""By name, in the order in which they run: a later one may read what an earlier one found."""
NAMES = {
    "curve": "friction curve",
    "lsm": "line fits",
    "sje": "single joints",
    "choice": "chosen settings",
    "gte": "paths",
    "ensemble": "set-ups of the paths",
}
"""What a progress bar calls them."""
