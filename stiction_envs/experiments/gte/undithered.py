"""Undithered runs of the Generated Trajectory Experiment, computed once: units of the rewards."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.control.compensation import Compensation
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import (
    TRAJECTORIES,
    Case,
    Run,
    Stiffness,
    episode_settings,
)
from stiction_envs.experiments.gte.random_paths import path_number
from stiction_envs.precomputed import store

Key = tuple[str, Stiffness]  # Trajectory and stiffness
KIND, RANDOM_KIND = "undithered", "undithered_random"


@dataclass(frozen=True, kw_only=True, eq=False)
class Undithered:
    """Means over the iterations of one trajectory at one stiffness, without dither."""

    total: Array  # (6,) absolute error summed over the samples of an episode [m, rad]
    window: Array  # (6,) the same within the window of Table 4.11 [m, rad]
    duration: float  # From the start to the end of the tail [s]
    left: Array  # (G, 2) error left when the arm's time at each goal is over [m, rad]
    shaking: float  # Vibration, turns included, root mean square over the motion [m]


def fingerprint(
    experiment: GeneratedTrajectoryExperiment, compensation: Compensation | None = None
) -> str:
    """Return a hash of everything that an undithered run depends on."""
    e, s = experiment, experiment.sticking
    paths = {name: e.path(name) for name in (*TRAJECTORIES, *e.paths)}
    return store.digest(
        *(s.arm.fingerprint, s.parameters, s.timestep, e.protocol, e.approach, e.settings),
        *(e.motion, e.interface, e.start, e.tool, paths, e.scatter, e.seed),
        None if e.controller_model is None else e.controller_model.fingerprint,
        *(compensation, e.sensing),
    )


def undithered(
    experiment: GeneratedTrajectoryExperiment,
    wanted: Collection[Key],
    compensation: Compensation | None = None,
) -> dict[Key, Undithered]:
    """Return undithered runs, compensated or not, per trajectory and stiffness.

    Results are means over the protocol's iterations (10), as `stiction gte` runs them; on random
    paths over the first `EpisodeSettings.undithered_iterations`; without scatter iterations are
    equal. Missing results are computed in one batch, which does not change them. Raise a
    StictionError for an arm that has no error.
    """
    of = fingerprint(experiment, compensation)
    out: dict[Key, Undithered] = {}
    for kind in (KIND, RANDOM_KIND):
        is_random = kind == RANDOM_KIND
        mine = [key for key in wanted if (path_number(key[0]) is not None) == is_random]
        names = {key: _name(experiment, key) for key in mine}
        known = store.recall(kind, of) if mine else {}
        # runs of one batch take as long as its longest: like with like
        missing = sorted(
            (key for key, name in names.items() if name not in known),
            key=lambda key: experiment.nominal_duration(experiment.path(key[0])),
        )
        if missing:
            iterations = episode_settings().undithered_iterations if is_random else None
            cases = [Case(trajectory=t, stiffness=k, compensation=compensation) for t, k in missing]
            runs = experiment.run(cases, iterations=iterations if experiment.scatter else 1)
            pairs = zip(missing, runs, strict=True)
            store.keep(kind, of, {names[key]: _summary(experiment, run) for key, run in pairs})
            known = store.recall(kind, of)
        for key, name in names.items():
            kept: store.Values = known[name]
            arrays = {k: np.array(x) for k, x in kept.items() if isinstance(x, list)}
            out[key] = Undithered(**(kept | arrays))
    return out


def _name(experiment: GeneratedTrajectoryExperiment, key: Key) -> str:
    """Return the store's key of a path at a stiffness; a random path's key has its content."""
    trajectory, stiffness = key
    of = [trajectory]
    if path_number(trajectory) is not None:
        of.append(store.digest(experiment.path(trajectory))[:8])
    return " ".join([*of, *(repr(float(k)) for k in stiffness)])


def _summary(experiment: GeneratedTrajectoryExperiment, run: Run) -> store.Values:
    measures = Measures(run, experiment.protocol)
    duration = measures.duration + experiment.protocol.tail
    total, left = measures.total_error.mean(axis=0), measures.left.mean(axis=0)
    if not ((total > 0).all() and (left > 0).all()):
        raise StictionError(
            f"{experiment.sticking.arm.name}: {run.case.trajectory} at stiffness "
            f"{run.case.stiffness} has no error without dither"
        )
    return {
        "total": total.tolist(),
        "window": measures.window_sum.mean(axis=0).tolist(),
        "left": left.tolist(),
        "duration": float(duration.mean()),
        "shaking": float(measures.shaking.mean()),
    }
