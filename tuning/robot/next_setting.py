"""The next settings to measure, the best setting so far, and the rule to stop.

The criterion is the expected improvement over the best measured setting (Jones, Schonlau & Welch,
Efficient global optimization of expensive black-box functions, J. Global Optim. 13, 1998) of the
difference of two settings, whose common errors cancel. For several at once, each is added with its
posterior mean as measurement before the next is chosen (kriging believer: Ginsbourger, Le Riche &
Carraro 2010).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from stiction_envs.arrays import Array, Bools
from tuning.robot.posterior import Candidates, Posterior, Readings, posterior_of
from tuning.settings import RobotSettings


def best_measured(posterior: Posterior, readings: Readings) -> int | None:
    """Return the setting of the lowest posterior mean that was measured in all four configurations.

    None if no eligible setting was.
    """
    measured = np.flatnonzero(readings.measured & posterior.eligible)
    return int(measured[posterior.mean[measured].argmin()]) if len(measured) else None


def open_settings(readings: Readings, eligible: Bools) -> Bools:
    """Return (S,) whether a setting may be proposed: not fully measured, and nothing failed."""
    return np.asarray(eligible & ~readings.tried.all(axis=1) & ~readings.failed)


def expected_improvement(posterior: Posterior, best: int | None) -> Array:
    """Return (S,) expected reduction of |τ|/|τ_base| below that of ``best`` [-].

    Without a best one so far, it is the predicted effect: the lowest mean comes first.
    """
    if best is None:
        return 1.0 + posterior.mean.max() - posterior.mean
    mean, sd = posterior.advantage(best)
    z = mean / np.maximum(sd, 1e-12)
    return np.asarray(mean * ndtr(z) + sd * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))


def next_settings(
    candidates: Candidates, readings: Readings, count: int, s: RobotSettings
) -> list[int]:
    """Return up to ``count`` settings to measure next, the most promising first.

    A setting that was measured in some configurations may be among them, for the others. The list
    is shorter, or empty, when every setting was measured.
    """
    chosen: list[int] = []
    while len(chosen) < count:
        free = open_settings(readings, candidates.eligible)
        if not free.any():
            break
        posterior = posterior_of(candidates, readings, s)
        gain = expected_improvement(posterior, best_measured(posterior, readings))
        setting = int(np.where(free, gain, -np.inf).argmax())
        chosen.append(setting)
        missing = np.flatnonzero(~readings.tried[setting])
        readings = readings.with_rows(
            [(setting, int(c), float(posterior.cell_mean[setting, c])) for c in missing]
        )
    return chosen


def chance_of_better(posterior: Posterior, readings: Readings, s: RobotSettings) -> float:
    """Return the probability that any untried setting beats the best one by the tolerance [-].

    The probability is for all untried settings together, estimated from draws: 1 where none was
    fully measured, 0 where none is left. Stop when it is below 1 − ``confidence``.
    """
    free = np.flatnonzero(open_settings(readings, posterior.eligible))
    best = best_measured(posterior, readings)
    if not len(free) or best is None:
        return float(len(free) > 0)
    at = np.append(free, best)
    values, vectors = np.linalg.eigh(posterior.covariance[np.ix_(at, at)])
    normal = np.random.default_rng(s.seed).standard_normal((s.draws, len(at)))
    drawn = posterior.mean[at] + normal @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    better = drawn[:, -1] - drawn[:, :-1].min(axis=1) > s.tolerance
    return float(better.mean())
