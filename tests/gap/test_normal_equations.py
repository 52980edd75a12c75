"""Sums over blocks against plain least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from stiction_envs.gap.normal_equations import Gram, JointGrams, ModelColumns, solve, solve_all

RNG = np.random.default_rng(0)
X, W = RNG.normal(size=(600, 3)), RNG.uniform(0.5, 1.0, 600)
R = X @ [1.0, -2.0, 0.5] + 0.1 * RNG.normal(size=600)
BLOCK = np.repeat(np.arange(6), 100)
FREE = ModelColumns(((0, 1, 2),), ((0, 1, 2),), (-np.inf,) * 3, (np.inf,) * 3)


def joint_grams() -> JointGrams:
    return JointGrams([Gram.of(X, R, BLOCK, W, 6)])


def least_squares(x: np.ndarray, r: np.ndarray, weight: np.ndarray) -> np.ndarray:
    root = np.sqrt(weight)
    return np.linalg.lstsq(x * root[:, None], r * root, rcond=None)[0]


def test_the_held_out_error_is_that_of_the_fit_to_the_other_blocks() -> None:
    out = joint_grams().held_out(FREE)
    for b in range(6):
        rest = b != BLOCK
        c = least_squares(X[rest], R[rest], W[rest])
        e = R[~rest] - X[~rest] @ c
        assert np.isclose(out[0, b], (W[~rest] * e * e).sum(), rtol=1e-5)


def test_the_fit_is_weighted_least_squares_with_multiplicities_of_blocks() -> None:
    """One block counts twice and one not at all; later fits do not remember it."""
    grams, weight = joint_grams(), np.array([2.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    for often in (None, np.ones(6), weight, None):
        expected = least_squares(X, R, W * (1.0 if often is None else often[BLOCK]))
        for _ in range(2):
            assert np.allclose(grams.fit(FREE, often), expected, atol=1e-6)


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


def test_a_cross_predicted_torque_matches_the_error_only_if_it_is_real() -> None:
    """Σpᵀe/Σpᵀp is one for the columns that are in the data, and pᵀe sums up to the gain."""
    own = np.array([False, True, False])
    rest = ModelColumns(((0, 2),), ((0, 1),), (-np.inf,) * 2, (np.inf,) * 2)
    pe, pp = joint_grams().cross_predicted(FREE, rest, own)
    assert np.isclose(pe.sum() / pp.sum(), 1.0, atol=0.03)
    gained = joint_grams().held_out(rest) - joint_grams().held_out(FREE)
    assert np.allclose(gained, 2 * pe - pp)
    assert np.isclose(joint_grams().gained(FREE, rest)[0], 2.0, rtol=0.1)


def test_no_columns_leave_the_residual() -> None:
    nothing = ModelColumns(((),), ((),), (), ())
    assert np.allclose(joint_grams().held_out(nothing).sum(), (W * R * R).sum())


def test_errors_and_sizes_are_those_of_the_torques() -> None:
    """Of two joints that share a coefficient, the second with one of its own."""
    rng = np.random.default_rng(5)
    y, r = rng.normal(size=(600, 2)), rng.normal(size=600)
    grams = JointGrams([Gram.of(X, R, BLOCK, W, 6), Gram.of(y, r, BLOCK, W / 2, 6)])
    model = ModelColumns(((0, 2), (1, 0)), ((0, 1), (1, 2)), (-np.inf,) * 3, (np.inf,) * 3)
    c = grams.fit(model)
    torques = X[:, [0, 2]] @ c[:2], y[:, [1, 0]] @ c[1:]
    left = [(w * (z - t) ** 2).sum() for w, z, t in zip((W, W / 2), (R, r), torques, strict=True)]
    assert np.allclose(grams.errors(model), left, rtol=1e-6)
    own = np.array([True, False, False])
    # over the noise: weights are 1/noise² times the largest, which counts as one row
    root_mean_square = np.sqrt((W * (X[:, 0] * c[0]) ** 2).sum() / (W.sum() / W.max()))
    assert np.allclose(grams.sizes(model, own), [root_mean_square, 0.0], rtol=1e-6)


def test_resamples_scatter_as_estimates_do() -> None:
    """Law checked: σ² (XᵀX)⁻¹, to what 400 resamples of 30 blocks can say."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=(3000, 2)) @ np.array([[1.0, 0.5], [0.0, 1.0]])
    r = x @ [1.0, -1.0] + 0.3 * rng.normal(size=3000)
    block = np.repeat(np.arange(30), 100)
    grams = JointGrams([Gram.of(x, r, block, np.ones(3000), 30)])
    free = ModelColumns(((0, 1),), ((0, 1),), (-np.inf,) * 2, (np.inf,) * 2)
    drawn, again = (grams.resample(free, 400, np.random.default_rng(0)) for _ in range(2))
    assert np.array_equal(drawn, again)
    expected = 0.3 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    assert np.allclose(drawn.std(axis=0), expected, rtol=0.35)
    assert np.allclose(drawn.mean(axis=0), [1.0, -1.0], atol=0.01)
    bounded = ModelColumns(((0, 1),), ((0, 1),), (-np.inf, -1.0), (1.0, np.inf))
    held = grams.resample(bounded, 50, np.random.default_rng(0))
    assert held[:, 0].max() <= 1.0 + 1e-9
    assert held[:, 1].min() >= -1.0 - 1e-9


def test_leaving_a_block_out_keeps_bounds() -> None:
    bounded = ModelColumns(((0, 1, 2),), ((0, 1, 2),), (-np.inf, -1.5, -np.inf), (np.inf,) * 3)
    c = joint_grams().leave_one_block_out(bounded)
    assert np.allclose(c[:, 1], -1.5)
    for b in range(6):
        keep = b != BLOCK
        expected = least_squares(X[keep][:, [0, 2]], (R + 1.5 * X[:, 1])[keep], W[keep])
        assert np.allclose(c[b, [0, 2]], expected, atol=1e-6)


def test_a_coefficient_on_a_bound_equals_it_exactly() -> None:
    """However the columns are scaled, and in every system of many."""
    rng = np.random.default_rng(8)
    low, high = np.full(4, -0.3), np.full(4, 1.5)
    x = rng.normal(size=(300, 50, 4)) * 10 ** rng.uniform(-3, 3, (300, 1, 4))
    c = solve_all(np.swapaxes(x, 1, 2) @ x, rng.normal(size=(300, 4)) * 100, low, high)
    near = (np.abs(c - low) < 1e-9) | (np.abs(c - high) < 1e-9)
    assert near.sum() > 300
    assert ((c == low) | (c == high))[near].all()
