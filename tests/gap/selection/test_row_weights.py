"""Weights of rows, and how many rows are one observation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from stiction_envs.gap.selection.row_weights import (
    certain,
    explained,
)
from stiction_envs.gap.settings import gap_settings

ROWS = 40_000


def test_rows_at_rest_below_the_level_of_friction_have_little_weight() -> None:
    """A joint that rests weighs little where its direction is open, unless it rests always."""
    s = gap_settings()
    t = np.arange(1000) / 100

    def weights(moves: np.ndarray, direction: float) -> np.ndarray:
        path = np.cumsum(np.where(moves, 0.5, 0.0)) / 100
        data = SimpleNamespace(
            settings=s,
            reversal_path=path[:, None],
            runs=lambda: [slice(0, len(t))],
            dt=0.01,
            direction=lambda _: np.full(len(t), direction),
        )
        return certain(data, 0)

    half, hardly = weights(t < 5, 0.5), weights(t < 0.5, 0.5)
    np.testing.assert_array_equal(half[t < 4.9], 1.0)
    np.testing.assert_array_equal(half[t > 5.1], s.candidates.uncertain)
    np.testing.assert_array_equal(hardly, 1.0)
    np.testing.assert_array_equal(weights(t < 5, 0.95), 1.0)


def noise(size: float, repeats: int = 1) -> np.ndarray:
    rng = np.random.default_rng(0)
    return size * np.repeat(rng.normal(size=ROWS // repeats), repeats)


def test_rows_far_from_the_others_weigh_less() -> None:
    left = noise(0.1)
    left[::100] = 10.0
    weight = explained(left, 3.0)
    assert weight[::100] == pytest.approx(0.03, rel=0.05)  # 3 standard deviations over 10 N·m
    ordinary = np.abs(left) < 0.25
    assert (weight[ordinary] == 1.0).all()
    assert (explained(np.zeros(10), 3.0) == 1.0).all()
