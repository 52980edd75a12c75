"""The robot's clock behind jittery stamps: fast motion, odd clocks, clocks that drift for long."""

import numpy as np
import pytest

from stiction_envs.measured.logs.clock import correct_clock
from stiction_envs.measured.logs.corrections import RawLog


def log_of(t: np.ndarray, q: np.ndarray) -> RawLog:
    data = {"q": q, "tau": q.copy()}
    return RawLog(source="made", place=str, t=t, data=data, run=np.zeros(len(t), int))


def swaying(
    rate: float,
    motion_hz: float,
    *,
    rows: int = 5000,
    jitter: float = 0.1,
    lost: float = 0.0,
    drift: float = 0.0,
) -> tuple[RawLog, np.ndarray]:
    """Seven joints that sway, stamped with a jitter in steps; and the true times of the rows."""
    rng = np.random.default_rng(0)
    t = np.arange(rows) / rate
    hertz = motion_hz * np.array([1, 1.13, 0.81, 0.66, 1.3, 0.9, 1.2])
    q = 0.4 / max(motion_hz, 1) * np.sin(2 * np.pi * np.outer(t, hertz) + np.arange(7))
    q += 3e-6 * rng.normal(size=q.shape)
    keep = rng.random(rows) >= lost
    keep[0] = True
    stamp = t * (1 + drift) + jitter / rate * (2 * rng.random(rows) - 1)
    return log_of(stamp[keep], q[keep]), t[keep]


def wrong_steps(rows: RawLog, truth: np.ndarray, drift: float = 0.0) -> float:
    """Share of steps that are not the true ones; the ends have nothing to compare with."""
    off = np.abs(np.diff(rows.t) - np.diff(truth) * (1 + drift)) > 2e-4 * np.median(np.diff(truth))
    return float(off[30:-30].mean())


@pytest.mark.parametrize(
    ("rate", "motion_hz", "jitter"), [(1000.0, 3.5, 0.4), (200.0, 3.5, 0.03), (200.0, 0.3, 0.4)]
)
def test_fast_motion_hides_no_clock(rate: float, motion_hz: float, jitter: float) -> None:
    """Lines through fast motion are too flat, by up to 2 %: the step must not be so."""
    rows, truth = swaying(rate, motion_hz, jitter=jitter)
    corrections = correct_clock(rows)
    assert [m.kind for m in corrections] == ["clock"]
    assert wrong_steps(rows, truth) == 0


@pytest.mark.parametrize(("rate", "lost"), [(600.0, 0.06), (59.94, 0.0)])
def test_a_clock_of_no_whole_number_is_found(rate: float, lost: float) -> None:
    """The step of the clock comes from the stamps alone."""
    rows, truth = swaying(rate, 1.0, lost=lost, drift=3e-5)
    corrections = correct_clock(rows)
    assert [m.kind for m in corrections] == ["clock"]
    assert wrong_steps(rows, truth, 3e-5) < 0.005
    steps = np.round(np.diff(rows.t) * rate)
    np.testing.assert_allclose(np.diff(rows.t), steps / rate, rtol=2e-4)


def test_clocks_that_drift_apart_for_minutes() -> None:
    """80 ppm over 100 s are eight steps: still the robot's clock; the reader reports the drift."""
    rows, truth = swaying(1000.0, 0.3, rows=100_000, jitter=0.4, lost=0.06, drift=-8e-5)
    (correction,) = correct_clock(rows)
    assert wrong_steps(rows, truth) < 1e-4
    assert "regular 1 ms clock" in correction.text
    gained = float(correction.text.split("and gain ")[1].split(" millionths")[0])
    assert gained == pytest.approx(-80, abs=2)


def lost_in_stretches(rows: int = 6000, seed: int = 1) -> np.ndarray:
    """Rows of which 3 to 8 in a row are lost, at about one in a hundred."""
    rng = np.random.default_rng(seed)
    keep = np.ones(rows, bool)
    for start in np.flatnonzero(rng.random(rows) < 0.01):
        keep[start + 1 : start + 1 + rng.integers(3, 9)] = False
    return keep


def test_stamps_that_count_rows_hide_no_lost_samples() -> None:
    """The stamps go on regularly where samples are lost: only the angles jump."""
    rows, truth = swaying(500.0, 0.4, rows=6000, jitter=0.0)
    rows.keep(keep := lost_in_stretches())
    truth = truth[keep]
    rows.t = np.arange(len(truth)) / 500.0
    (correction,) = correct_clock(rows)
    assert correction.kind == "clock"
    assert "samples were lost" in correction.text
    np.testing.assert_allclose(rows.t[30:-30] - rows.t[30], (truth - truth[30])[30:-30], atol=1e-9)


def test_rows_that_arrive_late_in_bursts_keep_their_order_in_time() -> None:
    rows, truth = swaying(500.0, 0.4, rows=6000, jitter=0.0)
    rng = np.random.default_rng(2)
    for start in np.flatnonzero(rng.random(6000) < 0.01):
        burst = slice(start, min(start + int(rng.integers(4, 10)), 6000))
        rows.t[burst] = rows.t[burst][-1] + 2e-5 * np.arange(len(rows.t[burst]))
    rows.t = np.maximum.accumulate(rows.t) + 1e-7 * np.arange(6000)
    (correction,) = correct_clock(rows)
    assert correction.kind == "clock"
    np.testing.assert_allclose(np.diff(rows.t), np.diff(truth), atol=1e-9)


def test_an_arm_that_stops_and_starts_at_once_lost_no_samples() -> None:
    """All joints change their speed in the same row: the time goes on."""
    rows, truth = swaying(500.0, 0.4, rows=6000, jitter=0.0)
    at = np.r_[np.arange(2000.0), np.full(500, 1999.0), 1999.0 + 2 * np.arange(1500)]
    q = np.stack([np.interp(at, np.arange(6000), x) for x in rows.data["q"].T], axis=1)
    q += 3e-6 * np.random.default_rng(3).normal(size=q.shape)
    stopped = log_of(truth[:4000].copy(), q)
    assert correct_clock(stopped) == []
    np.testing.assert_array_equal(stopped.t, truth[:4000])
