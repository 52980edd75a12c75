"""The path of a joint behind noise and overshoot."""

import numpy as np
import pytest

from stiction_envs.filters import lowpass
from stiction_envs.gap.signals.reversals import reversal_path, zigzag

RATE = 500.0
T = np.arange(0, 6, 1 / RATE)


def test_a_path_turns_where_it_was_farthest_if_it_goes_back_by_more_than_the_band() -> None:
    x = np.array([0.0, 1.0, 0.8, 2.0, 1.5, 0.5, 0.9, -1.0])
    assert zigzag(x, 0.6) == pytest.approx([0, 1, 1, 2, 1.5, 0.5, 0.5, -1])
    assert zigzag(x, 0.1) == pytest.approx(x)


def turns(x: np.ndarray) -> int:
    steps = np.diff(x)
    return int(np.count_nonzero(np.diff(np.sign(steps[steps != 0]))))


def test_noise_at_rest_makes_few_turns_and_hardly_any_way() -> None:
    rng = np.random.default_rng(1)
    q = 5e-6 * rng.normal(size=T.shape)
    path = reversal_path(q, RATE, 10.0)
    assert turns(path) < 0.5 * turns(lowpass(q, RATE, 30.0))
    assert np.abs(np.diff(path)).sum() < 0.04 * np.abs(np.diff(q)).sum()


def test_a_stop_overshoots_less_than_through_the_filter_of_all_signals() -> None:
    """A joint that stops from 0.5 rad/s within 0.1 s."""
    v = 0.5 * np.clip((3.0 - T) / 0.1, 0, 1)
    q = np.cumsum(v) / RATE
    over = reversal_path(q, RATE, 10.0).max() - q[-1]
    assert over < 0.2 * (lowpass(q, RATE, 10.0).max() - q[-1])
