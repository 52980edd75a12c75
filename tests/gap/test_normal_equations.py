"""Sums over blocks against plain least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from stiction_envs.gap.normal_equations import Gram, JointGrams, ModelColumns, solve

RNG = np.random.default_rng(0)
X, W = RNG.normal(size=(600, 3)), RNG.uniform(0.5, 1.0, 600)
R = X @ [1.0, -2.0, 0.5] + 0.1 * RNG.normal(size=600)
BLOCK = np.repeat(np.arange(6), 100)
FREE = ModelColumns(((0, 1, 2),), ((0, 1, 2),), (-np.inf,) * 3, (np.inf,) * 3)


def stack() -> JointGrams:
    return JointGrams([Gram.of(X, R, BLOCK, W, 6)])


def test_the_fit_is_weighted_least_squares() -> None:
    root = np.sqrt(W)[:, None]
    expected = np.linalg.lstsq(X * root, R * root[:, 0], rcond=None)[0]
    assert np.allclose(stack().fit(FREE), expected, atol=1e-6)


def test_the_held_out_error_is_that_of_the_fit_to_the_other_blocks() -> None:
    out = stack().held_out(FREE)
    for b in range(6):
        rest = b != BLOCK
        root = np.sqrt(W[rest])[:, None]
        c = np.linalg.lstsq(X[rest] * root, R[rest] * root[:, 0], rcond=None)[0]
        e = R[~rest] - X[~rest] @ c
        assert np.isclose(out[0, b], (W[~rest] * e * e).sum(), rtol=1e-5)


def test_rows_between_blocks_count_for_nothing() -> None:
    block = BLOCK.copy()
    block[250:350] = -1
    r = R.copy()
    r[250:350] = 1e6
    c = JointGrams([Gram.of(X, r, block, W, 6)]).fit(FREE)
    assert np.allclose(c, [1.0, -2.0, 0.5], atol=0.05)


def test_bounds_hold_and_the_others_adapt() -> None:
    xx, xr = X.T @ X, X.T @ R
    c = solve(xx, xr, np.array([-np.inf, 0.0, -np.inf]), np.full(3, np.inf))
    assert np.isclose(c[1], 0.0, atol=1e-9)
    expected = np.linalg.lstsq(X[:, [0, 2]], R, rcond=None)[0]
    assert np.allclose(c[[0, 2]], expected, atol=1e-6)


def test_a_coefficient_that_two_joints_share_fits_both() -> None:
    grams = [Gram.of(X[:, :1], k * X[:, 0], BLOCK, np.ones(600), 6) for k in (1.0, 3.0)]
    c = JointGrams(grams).fit(ModelColumns(((0,), (0,)), ((0,), (0,)), (-np.inf,), (np.inf,)))
    assert np.isclose(c[0], 2.0)


def test_bounded_fits_are_those_of_a_general_solver() -> None:
    """The active set against scipy's bounded least squares, on many random problems."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        x, r = rng.normal(size=(30, 6)) @ rng.normal(size=(6, 6)), rng.normal(size=30)
        low, high = -rng.uniform(0, 0.2, 6), rng.uniform(0, 0.2, 6)
        c = solve(x.T @ x, x.T @ r, low, high)
        best = lsq_linear(x, r, bounds=(low, high), method="bvls").x
        assert np.sum((r - x @ c) ** 2) <= np.sum((r - x @ best) ** 2) + 1e-6


def test_what_is_foretold_comes_true_for_what_is_real_only() -> None:
    """Σpᵀe/Σpᵀp is one for the columns that are in the data, and pᵀe sums up to the gain."""
    own = np.array([False, True, False])
    rest = ModelColumns(((0, 2),), ((0, 1),), (-np.inf,) * 2, (np.inf,) * 2)
    pe, pp = stack().cross_predicted(FREE, rest, own)
    assert np.isclose(pe.sum() / pp.sum(), 1.0, atol=0.03)
    gained = stack().held_out(rest) - stack().held_out(FREE)
    assert np.allclose(gained, 2 * pe - pp)
    assert np.isclose(stack().gained(FREE, rest)[0], 2.0, rtol=0.1)


def test_resamples_are_reproducible() -> None:
    one, two = (stack().resample(FREE, 20, np.random.default_rng(1)) for _ in range(2))
    assert np.array_equal(one, two)
    assert np.all(one.std(axis=0) > 0)


def test_no_columns_leave_the_residual() -> None:
    nothing = ModelColumns(((),), ((),), (), ())
    assert np.allclose(stack().held_out(nothing).sum(), (W * R * R).sum())
