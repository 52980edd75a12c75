"""Measures tables again: with frictions, seeds, paths and a start that the search has not seen.

Each measurement is a trial of a separate study, so that nothing is measured twice. The study's name
contains a digest of what is measured, so that other tables cannot be confused with these.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray
from optuna.distributions import CategoricalDistribution

from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured import AmplitudeRow
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.robots import Arm
from tuning.search.bounds import Bounds
from tuning.search.breakaway import Breakaway, BreakawayObjective, interval
from tuning.search.tracking import Place, Table, TrackingObjective, Treatment
from tuning.settings import SearchSettings
from tuning.study.record import Outcome, Record, Search
from tuning.study.samplers import sampler
from tuning.study.workers import Progress, fill

Array = NDArray[np.float64]
T = TypeVar("T")
MakeRecord = Callable[[str], Record]
"""Opens a study of this run by its name."""
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


def digest(things: object) -> str:
    """Return a short digest of what is measured."""
    return hashlib.sha256(repr(things).encode()).hexdigest()[:12]


class Unseen(TypedDict):
    """Arguments that both repeated measurements have in common."""

    bounds: Bounds
    frictions: Sequence[FrictionParameters]
    settings: SearchSettings
    record: MakeRecord
    progress: Progress | None


def another_start(arm: Arm, most: float, seed: int | Sequence[int]) -> Array:
    """Return joint angles (n,) [rad] up to ``most`` [rad] from the arm's rest, within limits."""
    low, high = arm.limits.position.T
    angles = arm.rest + most * np.random.default_rng(seed).uniform(-1.0, 1.0, arm.n)
    return np.clip(angles, low + most, high - most)


def verify_breakaway(
    experiment: SingleJointExperiment,
    tables: Mapping[str, Table],
    *,
    bounds: Bounds,
    frictions: Sequence[FrictionParameters],
    settings: SearchSettings,
    record: MakeRecord,
    progress: Progress | None,
) -> dict[str, dict[int, Breakaway]]:
    """Measure every joint of every table in the SJE."""
    rows = {(name, r.joint): r for name, table in tables.items() for r in table if r.amplitude_nm}
    distinct = list(dict.fromkeys(rows.values()))

    def measure(wanted: list[AmplitudeRow]) -> list[Outcome]:
        objective = BreakawayObjective(
            experiment, bounds, frictions, iterations=settings.verify_iterations
        )
        found = objective.measure(wanted)
        return [
            Outcome(
                values=(0.0,),
                measures={name: x.tolist() for name, x in vars(found[row]).items()},
            )
            for row in wanted
        ]

    made = record(f"verify-sje-{digest(distinct)}")
    known = dict(zip(distinct, measured_once(made, distinct, measure, progress), strict=True))
    names = ("tau", "ratio", "oscillation")
    out: dict[str, dict[int, Breakaway]] = {name: {} for name in tables}
    for (name, joint), row in rows.items():
        arrays = {k: np.array(known[row][k], dtype=float) for k in names}
        out[name][joint] = Breakaway(**arrays)
    return out


def verify_tracking(
    experiment: GeneratedTrajectoryExperiment,
    treatments: Mapping[str, Treatment],
    *,
    bounds: Bounds,
    frictions: Sequence[FrictionParameters],
    settings: SearchSettings,
    record: MakeRecord,
    progress: Progress | None,
    random: bool = False,
) -> dict[str, dict[str, PathResult]]:
    """Run every treatment on the path used for tuning and on others, random ones if wanted."""
    treatments = {NOTHING: Treatment(), **treatments}
    groups: dict[str, Sequence[str]] = {path: (path,) for path in PATHS}
    if random:
        groups[RANDOM] = [f"{RANDOM}-{k}" for k in range(settings.verify_random)]
    cases = [(name, path) for name in treatments for path in groups]

    def measure_all(wanted: list[tuple[str, str]]) -> list[Outcome]:
        out: dict[tuple[str, str], Outcome] = {}
        for path in dict.fromkeys(path for _, path in wanted):
            places: list[Place] = [(p, k) for p in groups[path] for k in thesis_stiffness()]
            objective = TrackingObjective(
                experiment,
                bounds,
                frictions,
                places,
                iterations=settings.verify_iterations,
                joints=range(1, experiment.n + 1),
            )
            mine = [case for case in wanted if case[1] == path]
            measured = objective.measure([treatments[name] for name, _ in mine])
            for case, found in zip(mine, measured, strict=True):
                ratios = found.by_friction(objective.plain)
                out[case] = Outcome(
                    values=(0.0,),
                    measures={
                        **{k: v.tolist() for k, v in ratios.items()},
                        "vibration_m": found.shaking[0],
                        "vibration_at_rest_m": found.shaking[1],
                        "power_w": float(found.power.mean()),
                        "torque_rate_nm_s": float(found.torque_rate.max()),
                    },
                )
        return [out[case] for case in wanted]

    made = record(f"verify-gte-{digest([list(treatments.items()), groups])}")
    known = measured_once(made, cases, measure_all, progress)
    result: dict[str, dict[str, PathResult]] = {name: {} for name in treatments}
    for (name, path), attributes in zip(cases, known, strict=True):
        names = ("vibration_m", "vibration_at_rest_m", "power_w", "torque_rate_nm_s")
        shaken = {k: attributes[k] for k in names}
        left: JsonRecord = {k: _left(attributes[k]) for k in LEFT}
        result[name][path] = PathResult(**left, **shaken)
    return result


def _left(ratios: list[float]) -> tuple[float, float, float]:
    """Return geometric mean and interval of ratios, one per friction."""
    mean, low, high = interval(np.log(np.array(ratios, dtype=float)))
    return float(np.exp(mean)), float(np.exp(low)), float(np.exp(high))


def measured_once(
    record: Record,
    things: Sequence[T],
    measure: Callable[[list[T]], list[Outcome]],
    progress: Progress | None,
) -> list[JsonRecord]:
    """Measure things once each, in one batch; return what was measured."""
    if not things:
        return []
    count = len(things)
    space = {"row": CategoricalDistribution(list(range(count)))}
    one = Search(
        record=record,
        space=space,
        sampler=sampler("random", space, seed=0),
        evaluations=count,
        batch=count,
        first=tuple({"row": k} for k in range(count)),
    )
    fill([one], lambda asked: measure([things[p["row"]] for _, p in asked]), progress)
    found = {t.params["row"]: dict(t.user_attrs) for t in record.trials}
    return [found[k] for k in range(count)]
