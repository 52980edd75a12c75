"""Measures tables again: with frictions, seeds, paths and a start that the search has not seen.

Finished measurements are kept in the run's folder, so that an interrupted one goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.robots import Arm
from tuning.search.bounds import Bounds
from tuning.search.breakaway import Breakaway, BreakawayObjective, interval
from tuning.search.tracking import Place, Table, TrackingObjective, Treatment
from tuning.settings import SearchSettings
from tuning.study.workers import Progress

Array = NDArray[np.float64]
PATHS = TRAJECTORIES
NOTHING = "no dither"
LEFT = ("position", "orientation", "resting_position", "resting_orientation")
"""Errors that are compared with those without dither."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathResult:
    """Effect of a table on one path in the GTE, over no dither; geometric means and intervals."""

    position: tuple[float, float, float]
    """Position error left, mean over the goals [-]."""
    orientation: tuple[float, float, float]
    """Orientation error left, mean over the goals [-]."""
    resting_position: tuple[float, float, float]
    """Position error left at the last goal, a second after the arm reached it [-]."""
    resting_orientation: tuple[float, float, float]
    """Orientation error left there [-]."""
    vibration_m: float
    """Vibration during the motion [m]."""
    vibration_at_rest_m: float
    """Vibration at rest [m]."""
    power_w: float
    """Power of the dither [W]."""
    torque_rate_nm_s: float
    """Largest change of torque on any joint [N·m/s]."""


@dataclass(frozen=True, kw_only=True)
class Verified:
    """All results of the repeated measurement."""

    breakaway: Mapping[str, Mapping[int, Breakaway]]
    """Per table and joint."""
    tracking: Mapping[str, Mapping[str, PathResult]]
    """Per table and path; empty where only the SJE was searched."""

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of the paths; `RANDOM` stands for all random ones."""
        return tuple(next(iter(self.tracking.values()), ()))


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """What both repeated measurements have in common."""

    bounds: Bounds
    frictions: Sequence[FrictionParameters]
    settings: SearchSettings
    kept: KeptRows
    """Finished measurements, of this run and of one that was interrupted."""
    progress: Progress | None

    def tell(self, done: int, count: int) -> None:
        """Report how many measurements are finished."""
        if self.progress is not None:
            self.progress(done, count)


def another_start(arm: Arm, most: float, seed: int | Sequence[int]) -> Array:
    """Return joint angles (n,) [rad] up to ``most`` [rad] from the arm's rest, within limits."""
    low, high = arm.limits.position.T
    angles = arm.rest + most * np.random.default_rng(seed).uniform(-1.0, 1.0, arm.n)
    return np.clip(angles, low + most, high - most)


def verify_breakaway(
    experiment: SingleJointExperiment, tables: Mapping[str, Table], unseen: Unseen
) -> dict[str, dict[int, Breakaway]]:
    """Measure every joint of every table in the SJE, all settings in one batch."""
    rows = {(name, r.joint): r for name, table in tables.items() for r in table if r.amplitude_nm}
    kept, repeats = unseen.kept, unseen.settings.verify_iterations
    missing = [row for row in dict.fromkeys(rows.values()) if repr(row) not in kept.every]
    unseen.tell(0, len(missing))
    if missing:
        objective = BreakawayObjective(
            experiment, unseen.bounds, unseen.frictions, iterations=repeats
        )
        for row, found in objective.measure(missing).items():
            kept.add(repr(row), {name: x.tolist() for name, x in vars(found).items()})
        unseen.tell(len(missing), len(missing))
    out: dict[str, dict[int, Breakaway]] = {name: {} for name in tables}
    for (name, joint), row in rows.items():
        arrays = {k: np.array(x, dtype=float) for k, x in kept.every[repr(row)].items()}
        out[name][joint] = Breakaway(**arrays)
    return out


def verify_tracking(
    experiment: GeneratedTrajectoryExperiment,
    treatments: Mapping[str, Treatment],
    unseen: Unseen,
    *,
    random: bool = False,
) -> dict[str, dict[str, PathResult]]:
    """Run every treatment on the path used for tuning and on others, random ones if wanted."""
    treatments = {NOTHING: Treatment(), **treatments}
    groups: dict[str, Sequence[str]] = {path: (path,) for path in PATHS}
    if random:
        groups[RANDOM] = [f"{RANDOM}-{k}" for k in range(unseen.settings.verify_random)]
    kept = unseen.kept
    for done, (path, places) in enumerate(groups.items()):
        unseen.tell(done, len(groups))
        keys = {name: f"{path} {treatment!r}" for name, treatment in treatments.items()}
        missing = [name for name, key in keys.items() if key not in kept.every]
        if missing:
            where: list[Place] = [(p, k) for p in places for k in thesis_stiffness()]
            found = _tracked(experiment, [treatments[name] for name in missing], where, unseen)
            for name, row in zip(missing, found, strict=True):
                kept.add(keys[name], row)
    unseen.tell(len(groups), len(groups))
    result: dict[str, dict[str, PathResult]] = {}
    for name, treatment in treatments.items():
        result[name] = {}
        for path in groups:
            row = kept.every[f"{path} {treatment!r}"]
            left = {k: _left(row[k]) for k in LEFT}
            result[name][path] = PathResult(**{**row, **left})
    return result


def _tracked(
    experiment: GeneratedTrajectoryExperiment,
    treatments: Sequence[Treatment],
    places: Sequence[Place],
    unseen: Unseen,
) -> list[JsonRecord]:
    """Return what treatments leave on some paths per friction, and how much they shake there."""
    objective = TrackingObjective(
        experiment,
        unseen.bounds,
        unseen.frictions,
        places,
        iterations=unseen.settings.verify_iterations,
        joints=range(1, experiment.n + 1),
    )
    return [
        {
            **{k: v.tolist() for k, v in found.by_friction(objective.plain).items()},
            "vibration_m": found.shaking[0],
            "vibration_at_rest_m": found.shaking[1],
            "power_w": float(found.power.mean()),
            "torque_rate_nm_s": float(found.torque_rate.max()),
        }
        for found in objective.measure(treatments)
    ]


def _left(ratios: list[float]) -> tuple[float, float, float]:
    """Return geometric mean and interval of ratios, one per friction."""
    mean, low, high = interval(np.log(np.array(ratios, dtype=float)))
    return float(np.exp(mean)), float(np.exp(low)), float(np.exp(high))
