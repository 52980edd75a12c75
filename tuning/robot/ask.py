"""Which settings to measure next, which one is best so far, and whether to go on.

Expected improvement over the best one measured (Jones, Schonlau & Welch, Efficient global
optimization of expensive black-box functions, J. Global Optim. 13, 1998), of the difference of two
settings, whose common errors cancel. Several at once: each is put in as if it had been measured as
believed before the next is chosen (kriging believer: Ginsbourger, Le Riche & Carraro 2010).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from tuning.robot.belief import Belief, believe
from tuning.robot.candidates import Candidates, Readings
from tuning.settings import RobotSettings, tuning_settings

Array = NDArray[np.float64]


def best_measured(belief: Belief, readings: Readings) -> int | None:
    """Return the setting that is believed lowest of those measured in all four configurations.

    None where no eligible one was.
    """
    measured = np.flatnonzero(readings.measured(len(belief.mean)) & belief.eligible)
    return int(measured[belief.mean[measured].argmin()]) if len(measured) else None


def open_settings(readings: Readings, eligible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (S,) whether a setting may be asked for: not measured in full, nothing failed."""
    done = readings.done(len(eligible)).all(axis=1)
    return np.asarray(eligible & ~done & ~readings.failed(len(eligible)))


def expected_improvement(belief: Belief, best: int | None) -> Array:
    """Return (S,) expected lowering of |τ|/|τ_base| below that of ``best`` [-].

    Without a best one so far it is the predicted effect: the lowest mean comes first.
    """
    if best is None:
        return 1.0 + belief.mean.max() - belief.mean
    mean, sd = belief.advantage(best)
    z = mean / np.maximum(sd, 1e-12)
    return np.asarray(mean * ndtr(z) + sd * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))


def next_settings(
    candidates: Candidates,
    readings: Readings,
    count: int = 1,
    settings: RobotSettings | None = None,
) -> list[int]:
    """Return up to ``count`` settings to measure next, the most promising first.

    One that was measured in some configurations only may be among them: for the others. Fewer
    come back, or none, where every setting has been tried.
    """
    s = settings or tuning_settings().robot
    chosen: list[int] = []
    while len(chosen) < count:
        free = open_settings(readings, candidates.eligible)
        if not free.any():
            break
        belief = believe(candidates, readings, s)
        gain = expected_improvement(belief, best_measured(belief, readings))
        setting = int(np.where(free, gain, -np.inf).argmax())
        chosen.append(setting)
        missing = np.flatnonzero(~readings.done(len(candidates))[setting])
        readings = readings.with_rows(
            [(setting, int(c), float(belief.cell_mean[setting, c])) for c in missing]
        )
    return chosen


def chance_of_better(
    belief: Belief, readings: Readings, settings: RobotSettings | None = None
) -> float:
    """Return the probability that any untried setting beats the best one by the tolerance [-].

    Of all untried ones together, counted over draws from the belief. 1 where none was measured in
    full, 0 where nothing is left to try. Stop asking when it is under 1 − ``confidence``.
    """
    s = settings or tuning_settings().robot
    free = np.flatnonzero(open_settings(readings, belief.eligible))
    best = best_measured(belief, readings)
    if not len(free) or best is None:
        return float(len(free) > 0)
    at = np.append(free, best)
    values, vectors = np.linalg.eigh(belief.covariance[np.ix_(at, at)])
    normal = np.random.default_rng(s.seed).standard_normal((s.draws, len(at)))
    drawn = belief.mean[at] + normal @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    better = drawn[:, -1] - drawn[:, :-1].min(axis=1) > s.tolerance
    return float(better.mean())


def may_stop(belief: Belief, readings: Readings, settings: RobotSettings | None = None) -> bool:
    """Return whether `chance_of_better` is so small that asking ends."""
    s = settings or tuning_settings().robot
    return chance_of_better(belief, readings, s) < 1.0 - s.confidence
