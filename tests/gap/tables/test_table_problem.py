"""Evidence of torque tables against the Gaussian density."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stiction_envs.gap.judge.problem import ARM, Term
from stiction_envs.gap.tables.table_problem import PRIOR, SCATTER, SIZES, Cells, TableProblem

FOLDS = 5
SMALL = Term("small errors", 0, small=True)
ONE, OTHER, BOTH = Term("one", 0), Term("other", 1), Term("both", ARM)


def density(columns, residual, fold, size):
    """Return the logarithm of the density of a joint's residual, all coefficients integrated."""
    scatter, common = SCATTER * size
    together = (fold[:, None] == fold) & (fold > 0)  # base torques have no common error
    covariance = scatter**2 * np.eye(len(fold)) + common**2 * together + columns.T @ columns
    return multivariate_normal(cov=covariance).logpdf(residual)


@pytest.fixture
def drawn():
    """Columns (k, T), residual and fold of two joints, one with an error common to each fold."""
    rng = np.random.default_rng(3)
    out = []
    for common in (0.0, 0.05):
        fold = np.repeat(np.arange(FOLDS), 4)
        residual = 0.02 * rng.normal(size=20) + common * rng.normal(size=FOLDS)[fold]
        out.append((0.03 * rng.normal(size=(3, 20)), residual, fold))
    return out


@pytest.fixture
def problem(drawn):
    """Two joints: a small error of the first, a cause on each, and one of both."""
    made = TableProblem([Cells(r, f, FOLDS) for _, r, f in drawn], np.empty(0))
    (first, *_), (second, *_) = drawn
    free = np.full(1, np.inf)
    for term, columns in (
        (SMALL, {0: first[:1]}),
        (ONE, {0: first[1:2]}),
        (OTHER, {1: second[1:2]}),
        (BOTH, {0: first[2:], 1: second[2:]}),
    ):
        made.add(term, columns, np.ones(1), (-free, free), 0.0 if term.small else 2.0)
    return made


def test_a_score_is_the_density_at_the_likeliest_errors(problem, drawn):
    (x, *one), (y, *other) = drawn
    constant = 20 * np.log(2 * np.pi)
    for k, (columns, some) in enumerate(((x[:2], one), (y[1:2], other))):
        each = problem.likelihoods(k, [SMALL, ONE, OTHER])
        direct = [density(columns, *some, size) for size in SIZES] + PRIOR
        np.testing.assert_allclose(each, direct + constant / 2, rtol=1e-6)
    best = [problem.likelihoods(k, [SMALL, ONE, OTHER]).max() for k in range(2)]
    assert problem.score([ONE, OTHER]) == pytest.approx(sum(best) - 2 * 2.0, rel=1e-6)


def test_a_fold_that_is_held_out_has_no_part(problem, drawn):
    """The fit without a fold is that of a table which lacks its readings."""
    lacking = TableProblem([Cells(r[f != 2], f[f != 2], FOLDS) for _, r, f in drawn], np.empty(0))
    free = np.full(1, np.inf)
    for k, term in enumerate((ONE, OTHER)):
        columns, _, fold = drawn[k]
        lacking.add(term, {k: columns[1:2, fold != 2]}, np.ones(1), (-free, free), 0.0)
    sizes = (30, 40)
    problem, lacking = problem.on(problem.channels, sizes), lacking.on(lacking.channels, sizes)
    terms = [ONE, OTHER]
    np.testing.assert_allclose(problem.without(2).fit(terms), lacking.fit(terms), rtol=1e-5)
    assert abs(problem.fit(terms) - lacking.fit(terms)).max() > 1e-3


def test_a_common_error_is_seen_where_it_is(problem):
    assert problem.common_nats(0, []) < 1.0
    assert problem.common_nats(1, []) > 5.0
