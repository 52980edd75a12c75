from __future__ import annotations

import numpy as np
import pytest

from tests.tuning.robot.made_up import NOTHING, S, joint, posterior_of, read
from tuning.robot.posterior import Readings, discrepancy_kernel

PREDICTED = np.array([0.9, 0.8, 0.85, 0.95, 0.7])


def test_one_reading_by_hand():
    """Gain k/(k + σ²) of one cell's discrepancy (Rasmussen & Williams 2.25)."""
    posterior = posterior_of(joint(PREDICTED), Readings.of([(2, 1, 0.80)]))
    k = S.offset**2 + S.configuration**2 + S.shape**2 + S.setting**2
    expected = 0.85 - 0.05 * k / (k + S.noise**2)
    assert posterior.cell_mean[2, 1] == pytest.approx(expected)


def test_advantage_knows_what_two_settings_share():
    posterior = posterior_of(joint(PREDICTED), NOTHING)
    mean, sd = posterior.advantage(1)
    np.testing.assert_allclose(mean, PREDICTED[1] - PREDICTED)
    assert sd[1] == 0
    assert (sd[[0, 2, 3, 4]] < np.sqrt(2) * posterior.sd[0]).all()
    # far apart only the setting's and the shape's own parts differ
    assert sd.max() <= np.sqrt(2 * (S.setting**2 + S.shape**2)) + 1e-12


def test_the_interval_holds_what_it_says():
    """Robots drawn from the posterior itself: 95 % of untried settings are in the 95 % interval."""
    c = joint(np.linspace(0.95, 0.7, 8))
    k = discrepancy_kernel(S)(c.features)
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(c.predicted.ravel(), k, size=150).reshape(150, 8, 4)
    inside = []
    for truth in drawn:
        readings = read(truth + S.noise * rng.normal(size=truth.shape), [0, 4, 7])
        posterior = posterior_of(c, readings)
        apart = (truth.mean(axis=1) - posterior.mean) / posterior.sd
        inside.append(np.abs(apart[[1, 2, 3, 5, 6]]) < 1.96)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
