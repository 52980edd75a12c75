"""Undithered runs of the Generated Trajectory Experiment, once per process: what 1 is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.gte_layout import Stiffness
from stiction_envs.envs.sje_base import digest
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure, sample_period
from stiction_envs.experiments.gte.protocol import Case, Run
from stiction_envs.friction.parameters import QUANTITIES

Array = NDArray[np.float64]
Key = tuple[str, Stiffness]
"""Trajectory and stiffness."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Undithered:
    """Means over the iterations of one trajectory at one stiffness, without dither."""

    total: Array
    """(6,) absolute error summed over the samples of an episode [m, rad]."""
    window: Array
    """(6,) the same within the window of Table 4.11 [m, rad]."""
    duration: float
    """From the start to the end of the tail [s]."""
    shaking: float
    """Vibration of the flange, root mean square over the motion [m]."""


_known: dict[tuple[str, Key], Undithered] = {}


def fingerprint(experiment: GeneratedTrajectoryExperiment) -> str:
    """Return a hash of everything that an undithered run depends on."""
    e, s = experiment, experiment.sticking
    settings = [getattr(e.settings, f.name) for f in dataclasses.fields(e.settings)]
    i, limits = e.interface, s.arm.limits
    return digest(
        *(s.arm.xml, s.timestep, e.protocol, e.approach, e.motion, e.scatter, e.seed),
        *(None if e.belief is None else e.belief.xml, *settings),
        *(i.controller_rate_hz, i.lowpass_hz, i.torque_rate, i.torque_limit),
        *(limits.position, limits.torque, e.start),
        *(getattr(s.parameters, k) for k in QUANTITIES),
    )


def undithered(
    experiment: GeneratedTrajectoryExperiment, wanted: Iterable[Key]
) -> dict[Key, Undithered]:
    """Return what the arm does without dither, per trajectory and stiffness.

    It is the mean over the protocol's iterations (10), as `stiction gte` runs them; without scatter
    they are all alike. What is missing is computed in one batch; a result does not depend on it.

    Raises:
        StictionError: an arm that never comes to the end of the path.
    """
    name = fingerprint(experiment)
    wanted = list(dict.fromkeys(wanted))
    missing = [key for key in wanted if (name, key) not in _known]
    cases = [Case(trajectory=t, stiffness=k) for t, k in missing]
    runs = experiment.run(cases, iterations=None if experiment.scatter else 1) if missing else []
    for key, run in zip(missing, runs, strict=True):
        _known[name, key] = _summary(experiment, run)
    return {key: _known[name, key] for key in wanted}


def _summary(experiment: GeneratedTrajectoryExperiment, run: Run) -> Undithered:
    period, tail = sample_period(run), experiment.protocol.tail
    measures = measure(run, experiment.protocol)
    duration = measures.duration + tail
    end = np.rint(measures.duration / period) + round(tail / period)
    counted = np.arange(run.error.shape[1]) < end[:, None]
    total = np.where(counted[..., None], np.abs(run.error), 0.0).sum(axis=1).mean(axis=0)
    if not (np.isfinite(duration).all() and (total > 0).all()):
        raise StictionError(
            f"{experiment.sticking.arm.name}: {run.case.trajectory} at stiffness "
            f"{run.case.stiffness} has no end, or no error, without dither"
        )
    return Undithered(
        total=total,
        window=measures.window_sum.mean(axis=0),
        duration=float(duration.mean()),
        shaking=float(measures.shaking.mean()),
    )
