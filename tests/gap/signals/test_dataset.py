"""Directions of friction, and rates, along a recording."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate
from tests.gap.small_logs import data_of, hidden, panda


@pytest.fixture(scope="module")
def data() -> Data:
    return data_of(panda(), hidden(panda(), seconds=6.0))


def test_directions_follow_the_presliding_distance(data: Data) -> None:
    soft = data.with_presliding(np.full(7, 0.02))
    assert np.abs(soft.directions - data.directions).max() > 0.5
    path, weight = data.reversal_path, np.ones(len(data.t))
    expected = bristles(path, data.runs(), np.full((7, 1), 0.02))[..., 0]
    np.testing.assert_array_equal(soft.directions, expected)
    own = grown(path[:, 1], data.runs(), 0.02, expected[:, 1], weight)
    np.testing.assert_array_equal(soft.growth(1, weight), own)


@pytest.mark.parametrize("shape", [(90,), (90, 4)])
def test_rates_are_those_of_numpy_within_each_segment_to_the_bit(shape: tuple[int, ...]) -> None:
    x = np.random.default_rng(0).normal(size=shape)
    runs = [slice(0, 50), slice(50, 51), slice(51, 53), slice(53, 56), slice(56, 90)]
    found = rate(x, runs, 0.003)
    for run in runs:
        few = run.stop - run.start < 3
        expected = np.zeros_like(x[run]) if few else np.gradient(x[run], 0.003, axis=0)
        np.testing.assert_array_equal(found[run], expected)
