"""The path of a joint: what noise and the filter's overshoot must not do to it."""

from __future__ import annotations

import numpy as np

from stiction_envs.gap.signals.prepare import lowpass
from stiction_envs.gap.signals.reversal_path import play, reversal_path

RATE = 500.0
T = np.arange(0, 6, 1 / RATE)


def test_a_pen_follows_beyond_its_slot_only() -> None:
    x = np.array([0.0, 0.5, 2.0, 1.5, 0.5, -1.0])
    pens = play(x, np.array([1.0, 0.0]))
    assert np.allclose(pens[:, 0], [0, 0, 1, 1, 1, 0])
    assert np.array_equal(pens[:, 1], x)


def test_noise_at_rest_makes_hardly_any_way() -> None:
    rng = np.random.default_rng(1)
    q = 5e-6 * rng.normal(size=T.shape)
    gone = np.abs(np.diff(reversal_path(q, RATE, 10.0, lowpass))).sum()
    assert gone < 0.5 * np.abs(np.diff(lowpass(q, RATE, 30.0))).sum()
    assert gone < 0.02 * np.abs(np.diff(q)).sum()


def test_a_stop_overshoots_less_than_through_the_filter_of_all_signals() -> None:
    """A joint that stops from 0.5 rad/s within 0.1 s."""
    v = 0.5 * np.clip((3.0 - T) / 0.1, 0, 1)
    q = np.cumsum(v) / RATE
    over = reversal_path(q, RATE, 10.0, lowpass).max() - q[-1]
    assert over < 0.2 * (lowpass(q, RATE, 10.0).max() - q[-1])
