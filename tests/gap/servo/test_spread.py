"""What a motion knows of a joint's lag, and of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.servo.fit import Fit, fit
from stiction_envs.gap.servo.parameters import INDEX
from stiction_envs.gap.servo.spread import LAG, Spread, estimates_of, lag_of, spread_of
from tests.gap.servo.small_arm import motion, parameters

FREE = ("damping", "delay")


def _fit(**values: float) -> Fit:
    none = np.zeros(0)
    return Fit(parameters=parameters(**values), free=FREE, angle=none, error=none)


def _spread(covariance: list[list[float]]) -> Spread:
    c = np.array(covariance)
    return Spread(names=FREE, covariance=c, correlation=np.eye(2), quantile=2.0)


def test_the_lag_is_delay_plus_damping_over_stiffness() -> None:
    """Its interval is that of the sum: what the parts trade with each other does not widen it."""
    found = _fit(damping=0.4, delay=0.01)  # stiffness 20
    traded = _spread([[0.04, -0.002], [-0.002, 1e-4 + 1e-6]])  # (0.2 N·m·s/rad)², (0.01 s)²
    lag = lag_of(found, traded, parameters(), needed=("damping", "delay"))
    assert lag is not None
    assert lag.value == pytest.approx(0.03)
    # variance: 0.04/400 + 1.01e-4 − 2·0.002/20 = 1e-6
    assert lag.ci95 == pytest.approx((0.028, 0.032))


@pytest.mark.parametrize(
    ("covariance", "needed"),
    [
        ([[1e-4, 0.0], [0.0, 1e-2]], ("damping",)),  # the damping is known
        ([[4.0, 0.0], [0.0, 1e-2]], ()),  # nor is the sum known
    ],
)
def test_no_lag_where_a_part_is_known_or_the_sum_is_not(covariance, needed) -> None:
    found = _fit(damping=0.4, delay=0.01)
    assert lag_of(found, _spread(covariance), parameters(), needed=needed) is None


def test_no_lag_where_the_simulation_has_it() -> None:
    spread = _spread([[1e-4, 0.0], [0.0, 1e-8]])
    assert lag_of(_fit(damping=0.4), spread, parameters(damping=0.4), needed=()) is None


def _seen(command: np.ndarray, truth: np.ndarray):
    q = motion(command).simulate(truth[None])[0]
    return motion(command, q=q + 1e-3 * np.random.default_rng(0).normal(size=len(q)))


def test_slow_motion_knows_the_sum_and_fast_motion_the_parts() -> None:
    """A steady motion follows late by delay + damping/stiffness, whichever it is."""
    t, truth = 0.01 * np.arange(3000), parameters(damping=0.8, delay=0.02)
    spreads = {}
    for f in (0.05, 1.5):
        log = _seen(0.3 * np.sin(2 * np.pi * f * t), truth)
        found = fit(log, truth, FREE)
        block = (t // 2.0).astype(np.int64)
        spreads[f] = spread_of(log, found, FREE, np.ones(len(t), dtype=bool), block)
        for name, e in estimates_of(found, spreads[f]).items():
            half = spreads[f].half_of(name)
            assert e.ci95 == pytest.approx((found[name] - half, found[name] + half))
            assert abs(found[name] - truth[INDEX[name]]) < 2.0 * half
        weights = np.array([1 / 20.0, 1.0])
        lag = found["delay"] + found["damping"] / 20.0
        assert lag == pytest.approx(0.06, abs=2.0 * spreads[f].half(weights))
    assert abs(spreads[0.05].correlation[0, 1]) > 0.999
    assert spreads[0.05].half(weights) < 0.05 * spreads[0.05].half_of("delay")
    assert spreads[1.5].half_of("delay") < 0.01 * spreads[0.05].half_of("delay")


def test_parts_are_those_of_one_parameter_each() -> None:
    assert set(LAG) <= set(INDEX)
