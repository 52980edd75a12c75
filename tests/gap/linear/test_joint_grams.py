"""Sums over blocks against plain least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from stiction_envs.gap.linear.bounded_fit import solve, solve_all
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.linear.joint_grams import JointGrams
from stiction_envs.gap.linear.model_columns import ModelColumns

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


def test_a_column_that_only_one_block_shows_has_no_part_without_that_block() -> None:
    """The tail of a filter or rounding elsewhere is no column: others fit as if it were none."""
    x = X.copy()
    x[BLOCK != 2, 2] *= 1e-9
    fits = JointGrams([Gram.of(x, R, BLOCK, W, 6)]).leave_one_block_out(FREE)
    rest = BLOCK != 2
    expected = least_squares(x[rest, :2], R[rest], W[rest])
    np.testing.assert_allclose(fits[2], [*expected, 0.0], rtol=1e-6)
    assert np.all(fits[[0, 1, 3, 4, 5], 2] != 0)


def test_the_fit_is_weighted_least_squares_with_multiplicities_of_blocks() -> None:
    """One block counts twice and one not at all; later fits do not remember it."""
    grams, weight = joint_grams(), np.array([2.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    for often in (None, np.ones(6), weight, None):
        expected = least_squares(X, R, W * (1.0 if often is None else often[BLOCK]))
        for _ in range(2):
            assert np.allclose(grams.fit(FREE, often), expected, atol=1e-6)


def test_bounded_fits_are_those_of_a_general_solver() -> None:
    """The active set against scipy's bounded least squares, on many random problems."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        x, r = rng.normal(size=(30, 6)) @ rng.normal(size=(6, 6)), rng.normal(size=30)
        low, high = -rng.uniform(0, 0.2, 6), rng.uniform(0, 0.2, 6)
        c = solve(x.T @ x, x.T @ r, low, high)
        best = lsq_linear(x, r, bounds=(low, high), method="bvls").x
        assert np.sum((r - x @ c) ** 2) <= np.sum((r - x @ best) ** 2) + 1e-6


def test_a_system_that_is_not_positive_definite_has_a_fit_within_bounds() -> None:
    """Blocks that were taken off may leave rounding larger than the ridge."""
    xx = np.array([[[1.0, 1.0 + 1e-7], [1.0 + 1e-7, 1.0]]])
    c = solve_all(xx, np.array([[1.0, 1.0]]), np.full(2, -2.0), np.full(2, 2.0))
    assert np.all(np.abs(c) <= 2.0)
    assert np.isclose(c.sum(), 1.0, atol=1e-3)


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


def with_random_effects() -> tuple[list[Gram], np.ndarray, ModelColumns]:
    """Three joints that share four random effects, two that share a coefficient with a bound."""
    rng, r, block = np.random.default_rng(9), 4, np.repeat(np.arange(5), 50)
    grams = []
    for _ in range(3):
        x = rng.normal(size=(250, r + 6))
        y = x @ rng.normal(size=r + 6) * 0.1 + rng.normal(size=250)
        grams.append(Gram.of(x, y, block, np.ones(250), 5))
    model = ModelColumns(
        columns=((r, r + 2), (r + 1,), (r + 3,)),
        coefficients=((r, r + 1), (r + 2,), (r,)),
        low=(-np.inf,) * r + (-np.inf, 0.1, -np.inf),
        high=(np.inf,) * (r + 3),
        firm=(10.0,) * r + (0.0, 0.0, 3.0),
        random=r,
    )
    return grams, np.array([1.0, 2.0, 5.0]), model


def test_random_effects_are_coefficients_with_a_prior() -> None:
    """Eliminated first or solved for with all others: the same fit, with blocks left out too."""
    grams, inflation, model = with_random_effects()
    own = tuple(range(4))
    columns, coefficients = (
        tuple((*own, *x) for x in each) for each in (model.columns, model.coefficients)
    )
    plain = replace(model, columns=columns, coefficients=coefficients, random=0)
    fast, slow = JointGrams(grams, inflation), JointGrams(grams, inflation)
    for name in ("fit", "errors", "leave_one_block_out", "held_out", "log_evidence"):
        assert np.allclose(getattr(fast, name)(model), getattr(slow, name)(plain), atol=1e-7), name
    for some in (np.arange(7) < 4, np.arange(7) == 6):
        assert np.allclose(fast.sizes(model, some), slow.sizes(plain, some), atol=1e-7)
    assert np.isclose(fast.fit(model)[5], 0.1)  # the bound is reached


def test_the_evidence_is_the_likelihood_without_the_coefficients() -> None:
    """Of two sizes of the prior, against the Gaussian density of the data itself."""
    rng = np.random.default_rng(4)
    x = rng.normal(size=(60, 3))
    r = x @ rng.normal(size=3) * 0.4 + rng.normal(size=60)
    grams = JointGrams([Gram.of(x, r, np.repeat(np.arange(6), 10), np.ones(60), 6)])
    ours, theirs = [], []
    for sd in (0.1, 0.5):
        model = replace(FREE, firm=(sd**-2,) * 3)
        ours.append(grams.log_evidence(model))
        spread = np.eye(60) + sd**2 * x @ x.T
        theirs.append(-0.5 * (np.linalg.slogdet(spread)[1] + r @ np.linalg.solve(spread, r)))
    assert np.isclose(ours[1] - ours[0], theirs[1] - theirs[0], atol=1e-6)


def test_standard_errors_are_those_of_least_squares() -> None:
    found = np.sqrt(np.diag(JointGrams([Gram.of(X, R, BLOCK, W, 6)]).covariance(FREE)))
    assert np.allclose(found, np.sqrt(np.diag(np.linalg.inv((X.T * W) @ X))), rtol=1e-6)
