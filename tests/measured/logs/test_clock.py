"""The robot's clock behind jittery stamps: fast motion, odd clocks, clocks that drift for long."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.measured.logs.clock import correct_clock
from stiction_envs.measured.logs.corrections import Rows


def swaying(
    rate: float,
    motion_hz: float,
    *,
    rows: int = 5000,
    jitter: float = 0.1,
    lost: float = 0.0,
    drift: float = 0.0,
) -> tuple[Rows, np.ndarray]:
    """Seven joints that sway, stamped with a jitter in steps; and the true times of the rows."""
    rng = np.random.default_rng(0)
    t = np.arange(rows) / rate
    hertz = motion_hz * np.array([1, 1.13, 0.81, 0.66, 1.3, 0.9, 1.2])
    q = 0.4 / max(motion_hz, 1) * np.sin(2 * np.pi * np.outer(t, hertz) + np.arange(7))
    q += 3e-6 * rng.normal(size=q.shape)
    keep = rng.random(rows) >= lost
    keep[0] = True
    stamp = t * (1 + drift) + jitter / rate * (2 * rng.random(rows) - 1)
    t, q, stamp = t[keep], q[keep], stamp[keep]
    return Rows(t=stamp, data={"q": q, "tau": q.copy()}, run=np.zeros(len(t), int)), t


def wrong_steps(rows: Rows, truth: np.ndarray, drift: float = 0.0) -> float:
    """Share of steps that are not the true ones; the ends have nothing to compare with."""
    off = np.abs(np.diff(rows.t) - np.diff(truth) * (1 + drift)) > 2e-4 * np.median(np.diff(truth))
    return float(off[30:-30].mean())


@pytest.mark.parametrize("rate", [1000.0, 200.0])
@pytest.mark.parametrize("motion_hz", [0.3, 3.5])
@pytest.mark.parametrize("jitter", [0.03, 0.4])
def test_fast_motion_hides_no_clock(rate: float, motion_hz: float, jitter: float) -> None:
    """Lines through fast motion are too flat, by up to 2 %: the step must not be so."""
    rows, truth = swaying(rate, motion_hz, jitter=jitter)
    corrections, warnings = correct_clock(rows)
    assert [m.kind for m in corrections] == ["clock"]
    assert warnings == []
    assert wrong_steps(rows, truth) == 0


@pytest.mark.parametrize(("rate", "lost"), [(600.0, 0.06), (59.94, 0.0)])
def test_a_clock_of_no_whole_number_is_found(rate: float, lost: float) -> None:
    """Its step comes from the stamps, which are all that can say it."""
    rows, truth = swaying(rate, 1.0, lost=lost, drift=3e-5)
    corrections, _ = correct_clock(rows)
    assert [m.kind for m in corrections] == ["clock"]
    assert wrong_steps(rows, truth, 3e-5) < 0.005
    steps = np.round(np.diff(rows.t) * rate)
    np.testing.assert_allclose(np.diff(rows.t), steps / rate, rtol=2e-4)


def test_clocks_that_drift_apart_for_minutes() -> None:
    """80 ppm over 200 s are sixteen steps: still the robot's clock, and the drift is told."""
    rows, truth = swaying(1000.0, 0.3, rows=200_000, jitter=0.4, lost=0.06, drift=-8e-5)
    (correction,), warnings = correct_clock(rows)
    assert warnings == []
    assert wrong_steps(rows, truth) < 1e-4
    assert "regular 1 ms clock" in correction.text
    gained = float(correction.text.split("and gain ")[1].split(" millionths")[0])
    assert gained == pytest.approx(-80, abs=2)
