"""Statistics of the policy benchmark: limit cases, and what scipy says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from benchmarks.learning.policies_statistics import (
    improvement_with_interval,
    interquartile_mean,
    mean_with_interval,
    probability_of_improvement,
    ratio_with_interval,
    resampled,
)


def test_interquartile_mean_leaves_the_outer_quarters_out():
    assert interquartile_mean(np.array([[-1e9, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 1e9]])) == 3.5


@pytest.mark.parametrize("worst", [10.0, np.inf])
def test_interquartile_mean_is_the_mean_of_the_middle_half_of_all(worst: float):
    scores = np.random.default_rng(0).lognormal(size=(5, 11))
    scores[2, :7] = worst
    middle = np.sort(scores.ravel())[13:-13]  # a quarter of 55, rounded down
    assert interquartile_mean(scores) == pytest.approx(middle.mean())


def test_scores_that_are_infinitely_bad_count_when_they_are_more_than_a_quarter():
    assert interquartile_mean(np.array([[1.0, 2.0, 3.0, np.inf]])) == 2.5
    assert interquartile_mean(np.array([[1.0, 2.0, np.inf, np.inf]])) == np.inf


def test_runs_are_drawn_within_their_task():
    scores = np.arange(12.0).reshape(4, 3)
    drawn = resampled(scores, np.random.default_rng(1), 200)
    assert drawn.shape == (200, 4, 3)
    for task in range(3):
        assert set(drawn[:, :, task].ravel()) == set(scores[:, task])


def test_runs_that_agree_leave_no_doubt_however_tasks_differ():
    scores = np.tile([1.0, 5.0, 100.0, 7.0], (5, 1))
    found = mean_with_interval(scores)
    assert (found.low, found.high) == (found.value, found.value) == (6.0, 6.0)


def test_the_interval_covers():
    # two sided, normal scores of ten runs on four tasks: true interquartile mean 0
    rng = np.random.default_rng(2)
    found = [mean_with_interval(rng.normal(size=(10, 4)), draws=400) for _ in range(200)]
    covered = np.mean([x.low <= 0 <= x.high for x in found])
    assert 0.85 < covered < 0.99


def test_the_same_scores_improve_in_half_of_the_pairs():
    scores = np.random.default_rng(3).normal(size=(5, 7))
    assert probability_of_improvement(scores, scores) == 0.5
    assert probability_of_improvement(np.ones((5, 3)), np.ones((5, 3))) == 0.5


def test_lower_scores_improve_for_sure():
    low, high = np.zeros((5, 3)), np.ones((4, 3))
    assert probability_of_improvement(low, high) == 1.0
    assert probability_of_improvement(high, low) == 0.0
    found = improvement_with_interval(low, high)
    assert (found.value, found.low, found.high) == (1.0, 1.0, 1.0)


def test_improvement_is_the_statistic_of_mann_and_whitney():
    rng = np.random.default_rng(6)
    ours, theirs = rng.integers(4, size=(2, 5, 30)).astype(float)  # many ties
    ours[0, :9] = theirs[1, 5:12] = np.inf
    wins = stats.mannwhitneyu(theirs, ours, axis=0, method="asymptotic").statistic
    assert probability_of_improvement(ours, theirs) == pytest.approx(wins.mean() / 25)


def test_improvement_is_counted_per_task():
    # better on one task of two: the other task's level does not matter
    ours, theirs = np.array([[0.0, 100.0]]), np.array([[1.0, 99.0]])
    assert probability_of_improvement(ours, theirs) == 0.5


def test_bootstrapped_improvement_is_around_the_estimate():
    rng = np.random.default_rng(4)
    found = improvement_with_interval(rng.normal(size=(5, 20)), rng.normal(0.5, size=(5, 20)))
    assert found.low < found.value < found.high
    # P(X < Y) of normals half a standard deviation apart
    assert found.value == pytest.approx(stats.norm.cdf(0.5 / np.sqrt(2)), abs=0.1)


def test_ratio_of_means():
    rng = np.random.default_rng(5)
    theirs = rng.uniform(1, 2, size=(5, 30))
    found = ratio_with_interval(0.5 * theirs, theirs)
    assert found.value == pytest.approx(0.5)
    assert found.low < 0.5 < found.high
