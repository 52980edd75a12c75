"""Measures tables again: with frictions, seeds, paths and a start that the search has not seen.

Finished measurements are kept in the run's folder, so that an interrupted one goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.kept_rows import KeptRows
from stiction_envs.robots import Arm
from tuning.search.bounds import Bounds, Table
from tuning.search.breakaway import Breakaway, BreakawayObjective, interval
from tuning.search.tracking import TrackingObjective, Treatment
from tuning.settings import SearchSettings
from tuning.study.workers import Progress

NOTHING, AT_REST = "no dither", "vibration_at_rest_m"


@dataclass(frozen=True, kw_only=True, eq=False)
class PathResult:
    """Effect of a treatment on one path in the GTE."""

    left: Mapping[str, tuple[float, float, float]]
    """Errors over those without treatment, by the names of `Tracking.by_friction`: geometric mean
    over frictions and its 95 % interval [-]."""
    totals: Mapping[str, float]  # Numbers of `Tracking.totals`


Tracked = Mapping[str, Mapping[str, PathResult]]
"""Results by treatment and path; `RANDOM` stands for all random paths."""


@dataclass(frozen=True, kw_only=True)
class Verified:
    """All results of the repeated measurement."""

    breakaway: Mapping[str, Mapping[int, Breakaway]]
    tracking: Tracked  # Empty where only the SJE was searched


def another_start(arm: Arm, most: float, seed: int | Sequence[int]) -> Array:
    """Return joint angles (n,) [rad] up to ``most`` [rad] from the arm's rest, within limits."""
    low, high = arm.limits.position.T
    angles = arm.rest + most * np.random.default_rng(seed).uniform(-1.0, 1.0, arm.n)
    return np.clip(angles, low + most, high - most)


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """Repeated measurements, under frictions that the search has not seen."""

    bounds: Bounds
    frictions: Sequence[FrictionParameters]
    settings: SearchSettings
    kept: KeptRows  # Finished measurements, of this run and of one that was interrupted
    progress: Progress

    def breakaway(
        self, experiment: SingleJointExperiment, tables: Mapping[str, Table]
    ) -> dict[str, dict[int, Breakaway]]:
        """Measure every joint of every table in the SJE, all settings in one batch."""
        rows = {(k, r.joint): r for k, table in tables.items() for r in table if r.amplitude_nm}
        every, repeats = self.kept.every, self.settings.verify_iterations
        missing = [row for row in dict.fromkeys(rows.values()) if repr(row) not in every]
        self.progress(0, len(missing))
        if missing:
            objective = BreakawayObjective(
                experiment, self.bounds, self.frictions, iterations=repeats
            )
            for row, found in objective.measure(missing).items():
                self.kept.add(repr(row), {name: x.tolist() for name, x in vars(found).items()})
            self.progress(len(missing), len(missing))
        out: dict[str, dict[int, Breakaway]] = {name: {} for name in tables}
        for (name, joint), row in rows.items():
            arrays = {k: np.array(x, dtype=float) for k, x in every[repr(row)].items()}
            out[name][joint] = Breakaway(**arrays)
        return out

    def tracking(
        self,
        experiment: GeneratedTrajectoryExperiment,
        treatments: Mapping[str, Treatment],
        *,
        random: bool,
    ) -> Tracked:
        """Run every treatment on the path used for tuning and on others, random ones if wanted."""
        treatments = {NOTHING: Treatment(), **treatments}
        groups: dict[str, Sequence[str]] = {path: (path,) for path in TRAJECTORIES}
        if random:
            groups[RANDOM] = [f"{RANDOM}-{k}" for k in range(self.settings.verify_random)]
        every = self.kept.every
        for done, (path, places) in enumerate(groups.items()):
            self.progress(done, len(groups))
            keys = {f"{path} {treatment!r}": treatment for treatment in treatments.values()}
            missing = {key: t for key, t in keys.items() if key not in every}
            if not missing:
                continue
            objective = TrackingObjective(
                *(experiment, self.bounds, self.frictions),
                [(place, k) for place in places for k in thesis_stiffness()],
                iterations=self.settings.verify_iterations,
            )
            for key, found in zip(missing, objective.measure([*missing.values()]), strict=True):
                left = found.by_friction(objective.plain)
                left_lists = {k: x.tolist() for k, x in left.items()}
                self.kept.add(key, {"left": left_lists, "totals": found.totals})
        self.progress(len(groups), len(groups))
        return {
            name: {path: _result(every[f"{path} {treatment!r}"]) for path in groups}
            for name, treatment in treatments.items()
        }


def _result(row: JsonRecord) -> PathResult:
    """Return a kept row with geometric means and intervals in place of a ratio per friction."""
    left = {k: np.exp(interval(np.log(np.array(x, dtype=float)))) for k, x in row["left"].items()}
    return PathResult(left={k: tuple(x.tolist()) for k, x in left.items()}, totals=row["totals"])
