"""Sums over paths: what they count, and that it does not matter how samples come in."""

from __future__ import annotations

import numpy as np

from stiction_envs.experiments.gte.measures import Accumulator

RATE, COUNT = 100.0, 700
ACCEPTED = np.array([[0.0, 2.0, 4.1], [0.0, 3.0, np.nan], [0.0, 1.5, np.nan]])
"""Of three arms with 3, 2 and 3 goals, the last of which never comes to its last."""
REACHED = np.array([[2.0, 4.1, 5.6], [3.0, 4.2, np.nan], [1.5, np.nan, np.nan]])
GOALS = np.array([3, 2, 3])


def samples() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    error = rng.normal(size=(3, COUNT, 6))
    return error, rng.uniform(size=(3, 6, COUNT)), rng.uniform(size=(3, COUNT))


def fed(block: int) -> Accumulator:
    """Made with blocks of samples; goals are known when a block is over, as from a rig."""
    out = Accumulator(3, 3, rate=RATE, window=1.0, tail=1.0)
    out.start(np.arange(3), GOALS)
    error, square, power = samples()
    for k in range(0, COUNT, block):
        known = (k + block) / RATE
        part = slice(k, k + block)
        times = (np.where(t < known, t, np.nan) for t in (ACCEPTED, REACHED))
        out.feed(error[:, part], square[:, :, part].copy(), *times, power[:, part])
    return out


RESULTS = (
    *("total_error", "maximum", "settling", "last", "over", "count", "mean", "rms", "vibration"),
    *("vibration_at_rest", "shaking", "dither_energy"),
)


def test_what_is_counted():
    """The motion ends with the last goal; the total with the tail; a path without end does not."""
    error, square, power = samples()
    sums = fed(70)
    for i, (end, tail) in enumerate(((560, 660), (420, 520), (COUNT, COUNT))):
        moving = error[i, :end]
        np.testing.assert_allclose(sums.total_error[i], np.abs(error[i, :tail]).sum(axis=0))
        np.testing.assert_allclose(sums.mean[i], np.abs(moving).mean(axis=0))
        np.testing.assert_allclose(sums.rms[i], np.sqrt((moving**2).mean(axis=0)))
        np.testing.assert_array_equal(sums.maximum[i], np.abs(moving).max(axis=0))
        np.testing.assert_allclose(sums.vibration[i] ** 2, square[i, :, :end].mean(axis=1))
        np.testing.assert_allclose(sums.dither_energy[i], power[i, :end].sum() / RATE)
        if end < COUNT:
            # whatever the others still do after that: no arm's number depends on how many run
            rest = square[i, :, end:tail].mean(axis=1)
            np.testing.assert_allclose(sums.vibration_at_rest[i] ** 2, rest)
    assert np.isnan(sums.vibration_at_rest[2]).all()
    np.testing.assert_array_equal(sums.over, [True, True, False])
    np.testing.assert_allclose(sums.step_error[2], np.abs(error[2, -70:]).sum(axis=0))
    assert not sums.step_error[1].any()


def test_settling_and_windows():
    """The last sample of the arm's time at each goal: before the next one, or of the tail."""
    error = samples()[0]
    sums = fed(10)
    np.testing.assert_array_equal(sums.settling[0], error[0, [199, 409, 659]])
    np.testing.assert_array_equal(sums.settling[1, :2], error[1, [299, 519]])
    np.testing.assert_array_equal(sums.settling[2, 0], error[2, 149])
    assert np.isnan(sums.settling[1, 2]).all(), "a path of two goals"
    assert np.isnan(sums.settling[2, 1:]).all(), "never reached"
    distance = np.linalg.norm(error[0, 409, :3])
    angle = np.linalg.norm(error[0, 409, 3:])
    np.testing.assert_allclose(sums.left[0, 1], [distance, angle])
    for i, window in ((0, slice(310, 510)), (1, slice(200, 400))):
        np.testing.assert_allclose(sums.window_sum[i], np.abs(error[i, window]).sum(axis=0))
    assert np.isnan(sums.window_sum[2]).all()


def test_starting_anew_forgets():
    """One arm begins a second path while the others go on: it counts like a first one."""
    sums, fresh = fed(100), Accumulator(3, 3, rate=RATE, window=1.0, tail=1.0)
    fresh.start(np.arange(3), GOALS)
    sums.start(np.array([1]), np.array([1]))
    fresh.start(np.array([1]), np.array([1]))
    error, square, _ = samples()
    times = np.array([[np.nan] * 3, [0.0, np.nan, np.nan], [np.nan] * 3])
    for x in (sums, fresh):
        x.feed(error[:, :150], square[:, :, :150].copy(), times, times + 1.2)
    for name in (*RESULTS, "step_error", "window_sum"):
        a, b = getattr(sums, name)[1], getattr(fresh, name)[1]
        np.testing.assert_array_equal(a, b, err_msg=name)
    assert sums.count[0] == COUNT + 150


def test_window_ends_with_the_record():
    """Its last error is held; what is complete stays as it is."""
    error, square, _ = samples()
    sums = Accumulator(3, 2, rate=RATE, window=0.5, tail=1.0)
    sums.start(np.arange(3), np.full(3, 2))
    accepted = np.array([[0.0, 3.0], [0.0, 6.8], [0.0, np.nan]])
    sums.feed(error, square, accepted, np.full((3, 2), np.nan))
    before = sums.window_sum.copy()
    assert np.isnan(before[1:]).all()
    sums.close()
    np.testing.assert_array_equal(sums.window_sum[0], before[0])
    held = np.concatenate([error[1, 630:], np.repeat(error[1, -1:], 30, axis=0)])
    np.testing.assert_allclose(sums.window_sum[1], np.abs(held).sum(axis=0))
    assert np.isnan(sums.window_sum[2]).all()
