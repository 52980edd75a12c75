"""Posterior of the settings, and which setting is measured next."""

import numpy as np
import pytest

from tests.tuning.robot.made_up import S, joint, posterior_of, read
from tuning.robot.posterior import Readings, discrepancy_kernel

PREDICTED = np.array([0.9, 0.8, 0.85, 0.95, 0.7])


def test_one_reading_by_hand():
    """Gain k/(k + σ²) of one cell's discrepancy (Rasmussen & Williams 2.25)."""
    posterior = posterior_of(joint(PREDICTED), Readings(5, [(2, 1, 0.80)]))
    k = S.offset**2 + S.configuration**2 + S.shape**2 + S.setting**2
    expected = 0.85 - 0.05 * k / (k + S.noise**2)
    assert posterior.cell_mean[2, 1] == pytest.approx(expected)


def test_advantage_knows_what_two_settings_share():
    posterior = posterior_of(joint(PREDICTED), Readings(5))
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


def repeated(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[:, None], 4, axis=1)


def test_a_batch_begins_with_the_single_ask_and_repeats_nothing():
    posterior = posterior_of(joint(PREDICTED), read(repeated(PREDICTED + 0.05), [4]))
    batch = posterior.next_settings(3)
    assert batch[0] == posterior.next_settings(1)[0]
    assert len(set(batch)) == 3
    assert 4 not in batch
    assert len(posterior.next_settings(10)) == 4


def test_a_failed_setting_is_neither_asked_again_nor_chosen():
    c = joint(PREDICTED)
    readings = read(repeated(PREDICTED), [1]).with_rows([(4, 0, 0.5), (4, 1, float("nan"))])
    posterior = posterior_of(c, readings)
    assert 4 not in posterior.next_settings(5)
    assert posterior.best == 1
    # measured again, and this time it moved
    again = readings.with_rows([(4, 1, 0.5), (4, 2, 0.5), (4, 3, 0.5)])
    assert posterior_of(c, again).best == 4


def test_chance_of_better_by_hand():
    """One untried setting, advantage N(0, 0.031²): better by 0.031 with 16 %."""
    for untried, chance, stop in ((0.9, 0.1587, False), (0.97, 0.0006, True)):
        posterior = posterior_of(joint([0.9, 0.9]), read(repeated(np.full(2, 0.9)), [0]))
        posterior.mean, posterior.covariance = np.array([0.9, untried]), np.diag([0.0, 0.031**2])
        assert posterior.chance_of_better == pytest.approx(chance, abs=0.02)
        assert posterior.may_stop == stop


def test_stopping_keeps_its_promise():
    """Robots drawn from the posterior: at most 5 % have a better untried setting."""
    c = joint(np.linspace(0.95, 0.75, 8))
    rng = np.random.default_rng(3)
    k = discrepancy_kernel(S)(c.features)
    broken, count = 0, 60
    for truth in rng.multivariate_normal(c.predicted.ravel(), k, size=count).reshape(-1, 8, 4):
        noisy = truth + S.noise * rng.normal(size=truth.shape)
        tried = [7]
        while not (posterior := posterior_of(c, read(noisy, tried))).may_stop:
            tried += posterior.next_settings(1)
        best = posterior.best
        rest = [x for x in range(8) if x not in tried]
        mean = truth.mean(axis=1)
        broken += bool(rest and mean[best] - mean[rest].min() > S.tolerance)
    # 5 % of 60 is 3, with a standard deviation of 1.7
    assert broken <= 6
