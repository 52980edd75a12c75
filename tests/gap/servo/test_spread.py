"""What a motion knows of a joint's lag, and of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.servo.fit import Fit
from stiction_envs.gap.servo.spread import Spread, lag_of
from tests.gap.servo.small_arm import parameters

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
