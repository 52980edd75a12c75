"""Least squares within bounds."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from stiction_envs.gap.judge.bounded_fit import solve


@pytest.mark.parametrize("seed", range(20))
def test_the_minimum_is_that_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = int(rng.integers(1, 30))
    x, y = rng.normal(size=(2 * p, p)) * 10 ** rng.uniform(-2, 2, p), rng.normal(size=2 * p)
    low = np.where(rng.random(p) < 0.5, 0.0, -np.inf)
    high = np.where(rng.random(p) < 0.3, 0.1, np.inf)
    a, b = x.T @ x, x.T @ y
    c = solve(a, b, low, high, np.linalg.solve(a, b))
    assert np.all((c >= low) & (c <= high))
    best = lsq_linear(x, y, bounds=(low, high), method="bvls", tol=1e-12).x
    assert np.sum((x @ c - y) ** 2) == pytest.approx(np.sum((x @ best - y) ** 2), rel=1e-9)


def test_what_is_within_its_bounds_is_solved_exactly_and_a_bound_is_met_exactly() -> None:
    a, b = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, -1.0])
    free = np.full(2, np.inf)
    exact = np.linalg.solve(a, b)
    np.testing.assert_allclose(solve(a, b, -free, free, exact), exact, rtol=1e-12)
    c = solve(a, b, np.zeros(2), free, exact)
    assert c[1] == 0.0
    assert c[0] == pytest.approx(1.5, rel=1e-12)
