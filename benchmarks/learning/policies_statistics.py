"""Statistics of few runs on many tasks, as rliable defines them.

Source: Agarwal, Schwarzer, Castro, Courville, Bellemare, Deep reinforcement learning at the edge of
the statistical precipice, NeurIPS 2021: interquartile mean (section 4.3), stratified bootstrap
(section 4.1: runs are drawn anew within each task) and probability of improvement (appendix).

Scores are (runs, tasks). A score that an episode does not have counts as infinitely bad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
DRAWS = 2000
"""Of a bootstrap."""
LEVEL = 0.95
"""Of an interval."""


@dataclass(frozen=True)
class Estimate:
    """A number and its bootstrap interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: Array) -> float:
    """Return the mean of the middle half of all scores, whatever their shape."""
    return float(_interquartile_means(np.ravel(scores)[None])[0])


def _interquartile_means(rows: Array) -> Array:
    """Return the interquartile mean of each row."""
    return np.asarray(stats.trim_mean(rows, 0.25, axis=1))


def resampled(scores: Array, rng: np.random.Generator, draws: int = DRAWS) -> Array:
    """Return scores (draws, runs, tasks): within each task, runs drawn with replacement."""
    runs, tasks = scores.shape
    chosen = rng.integers(runs, size=(draws, runs, tasks))
    return scores[chosen, np.arange(tasks)]


def mean_with_interval(scores: Array, *, seed: int = 0, draws: int = DRAWS) -> Estimate:
    """Return the interquartile mean with its stratified bootstrap interval (percentiles).

    Args:
        scores: (runs, tasks).
        seed: of the bootstrap.
        draws: of it.
    """
    drawn = resampled(scores, np.random.default_rng(seed), draws).reshape(draws, -1)
    return _estimate(interquartile_mean(scores), _interquartile_means(drawn))


def ratio_with_interval(ours: Array, theirs: Array, *, seed: int = 0) -> Estimate:
    """Return our interquartile mean over theirs, with its interval; both (runs, tasks)."""
    rng = np.random.default_rng(seed)
    means = [_interquartile_means(resampled(x, rng).reshape(DRAWS, -1)) for x in (ours, theirs)]
    return _estimate(interquartile_mean(ours) / interquartile_mean(theirs), means[0] / means[1])


def probability_of_improvement(ours: Array, theirs: Array) -> float:
    """Return the probability that a run of ours has a lower score than one of theirs.

    Mean over tasks of the Mann-Whitney U over the number of pairs: a tie counts one half.

    Args:
        ours: (runs, tasks).
        theirs: (their runs, tasks).
    """
    return float(_improvements(ours[None], theirs[None])[0])


def improvement_with_interval(ours: Array, theirs: Array, *, seed: int = 0) -> Estimate:
    """Return the probability of improvement with its stratified bootstrap interval."""
    rng = np.random.default_rng(seed)
    drawn = _improvements(resampled(ours, rng), resampled(theirs, rng))
    return _estimate(probability_of_improvement(ours, theirs), drawn)


def _improvements(ours: Array, theirs: Array) -> Array:
    """Return `probability_of_improvement` of scores (draws, runs, tasks), by comparing all pairs.

    The same as scipy's `mannwhitneyu`, which is twenty times slower since it also ranks.
    """
    a, b = ours[:, :, None], theirs[:, None]
    return np.asarray(((a < b) + 0.5 * (a == b)).mean(axis=(1, 2, 3)))


def worst_for_missing(scores: Array) -> Array:
    """Return scores whose missing ones are infinitely bad; lower is better."""
    return np.where(np.isnan(scores), np.inf, scores)


def _estimate(value: float, drawn: Array) -> Estimate:
    tail = 50 * (1 - LEVEL)
    # infinite scores have no differences to interpolate
    low, high = np.percentile(drawn, [tail, 100 - tail], method="nearest")
    return Estimate(value, float(low), float(high))
