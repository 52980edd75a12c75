"""Statistics of few runs on many tasks, as rliable defines them.

Source: Agarwal, Schwarzer, Castro, Courville, Bellemare, Deep reinforcement learning at the edge of
the statistical precipice, NeurIPS 2021: interquartile mean (section 4.3), stratified bootstrap
(section 4.1: runs are drawn anew within each task) and probability of improvement (appendix).

Scores are (runs, tasks). A score that an episode does not have counts as infinitely bad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
DRAWS = 2000
"""Of a bootstrap; assumed."""
LEVEL = 0.95
"""Of an interval; assumed."""


class Estimate(NamedTuple):
    """A number and its bootstrap interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: Array) -> float:
    """Return the mean of the middle half of all scores."""
    return float(stats.trim_mean(scores.ravel(), 0.25))


def resampled(scores: Array, rng: np.random.Generator, draws: int = DRAWS) -> Array:
    """Return scores (draws, runs, tasks): within each task, runs drawn with replacement."""
    runs, tasks = scores.shape
    chosen = rng.integers(runs, size=(draws, runs, tasks))
    return scores[chosen, np.arange(tasks)]


def _drawn_means(scores: Array, rng: np.random.Generator, draws: int = DRAWS) -> Array:
    """Return interquartile means (draws,) of resampled scores."""
    drawn = resampled(scores, rng, draws).reshape(draws, -1)
    return np.asarray(stats.trim_mean(drawn, 0.25, axis=1))


def mean_with_interval(scores: Array, *, draws: int = DRAWS) -> Estimate:
    """Return the interquartile mean with its stratified bootstrap interval (percentiles)."""
    drawn = _drawn_means(scores, np.random.default_rng(0), draws)
    return _estimate(interquartile_mean(scores), drawn)


def ratio_with_interval(ours: Array, theirs: Array) -> Estimate:
    """Return our interquartile mean over theirs, with its interval."""
    rng = np.random.default_rng(0)
    means = [_drawn_means(x, rng) for x in (ours, theirs)]
    return _estimate(interquartile_mean(ours) / interquartile_mean(theirs), means[0] / means[1])


def probability_of_improvement(ours: Array, theirs: Array) -> Array:
    """Return the probability that a run of ours has a lower score than one of theirs.

    Mean over tasks of the Mann-Whitney U over the number of pairs: a tie counts one half. All pairs
    are compared: scipy's `mannwhitneyu` also ranks, and is twenty times slower.

    Args:
        ours: (..., runs, tasks).
        theirs: (..., their runs, tasks).
    """
    a, b = ours[..., :, None, :], theirs[..., None, :, :]
    return np.asarray(((a < b) + 0.5 * (a == b)).mean(axis=(-3, -2, -1)))


def improvement_with_interval(ours: Array, theirs: Array) -> Estimate:
    """Return the probability of improvement with its stratified bootstrap interval."""
    rng = np.random.default_rng(0)
    drawn = probability_of_improvement(resampled(ours, rng), resampled(theirs, rng))
    return _estimate(float(probability_of_improvement(ours, theirs)), drawn)


def _estimate(value: float, drawn: Array) -> Estimate:
    tail = 50 * (1 - LEVEL)
    # infinite scores have no differences to interpolate
    low, high = np.percentile(drawn, [tail, 100 - tail], method="nearest")
    return Estimate(value, float(low), float(high))
