"""Least squares of the thesis."""

import numpy as np
import pytest

from stiction_envs.gap.validation.least_squares import least_squares, line
from tests.gap.signals.test_poses import poses
from tests.gap.small_logs import data_of, hidden, panda


def test_line_is_that_of_polyfit():
    """Equation 3.1 is ordinary least squares."""
    rng = np.random.default_rng(0)
    v = rng.uniform(0.1, 1.0, 200)
    tau = 0.5 + 0.2 * v + 0.05 * rng.normal(size=200)
    m, b, r2 = line(v, tau)
    np.testing.assert_allclose([m, b], np.polyfit(v, tau, 1))
    assert r2 == pytest.approx(np.corrcoef(v, tau)[0, 1] ** 2)


def test_line_without_a_spread_of_speeds_is_none():
    assert np.isnan(line(np.full(10, 0.3), np.arange(10.0))).all()
    assert np.isnan(line(np.zeros(0), np.zeros(0))).all()


def test_least_squares_is_right_on_clean_signals_and_says_where_not():
    """Without noise the bands come out; with noisy angles raw accelerations bury them."""
    arm = panda()
    clean = hidden(arm, lambda q, dq, ddq: 0.5 * np.sign(dq) + 0.3 * dq, noise=0.0)
    t = clean.t

    def fitted(noise: float):
        rng = np.random.default_rng(3)
        q = clean.q + noise * rng.normal(size=clean.q.shape)
        log = type(clean)(source="x.csv", t=t.copy(), q=q, dq=None, tau=clean.tau.copy())
        return least_squares([log], data_of(arm, log))

    good, bad = fitted(0.0), fitted(3e-4)
    for x in good.lines[10:]:  # joints 6 and 7 move little mass: q's own noise hardly counts
        sign = 1 if x.direction == "+" else -1
        assert x.intercept == pytest.approx(0.5 * sign, abs=0.15)
    assert min(x.r2 for x in bad.lines) < 0.1
    assert any("R²" in why for why in bad.breaks[2])
    assert any("raw differentiation" in why for why in bad.breaks[2])


def test_least_squares_of_poses_has_no_lines():
    """Poses have no speeds: no line, and it says why."""
    log = poses(count=30)
    found = least_squares([log], data_of(panda(), log))
    assert all(np.isnan(x.slope) and x.rows == 0 for x in found.lines)
    assert found.breaks[1] == ("it does not move in both directions",)
