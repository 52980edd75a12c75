"""The evidence against closed forms that need no sums: dense Gaussians."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stiction_envs.gap.judge.problem import ARM, Channel, Problem, Term

ROWS, FOLDS = 60, 3
FREE = (np.full(1, -np.inf), np.full(1, np.inf))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def problem_of(rng: np.random.Generator) -> tuple[Problem, np.ndarray, dict[Term, np.ndarray]]:
    """Return a problem of two channels, the measured values, and the columns of its terms."""
    fold = np.arange(ROWS) % FOLDS
    y = rng.normal(size=(ROWS, 2))
    problem = Problem([Channel(x, fold, FOLDS) for x in y.T], np.array([1.0, 4.0]))
    columns = {}
    for name, joint, on in (("a", 0, (0,)), ("b", 1, (1,)), ("tool", ARM, (0, 1))):
        term = Term(name, joint)
        x = rng.normal(size=(ROWS, 2)) * np.isin([0, 1], on)
        columns[term] = x
        problem.add(term, {k: x[None, :, k] for k in on}, np.array([0.7]), FREE, 1.5)
    return problem, y, columns


def test_the_evidence_is_the_density_of_what_was_measured(rng) -> None:
    problem, y, columns = problem_of(rng)
    noise = np.repeat([1.0, 4.0], ROWS)  # rows that form one observation weigh one together

    def density(terms: list[Term]) -> float:
        cov = np.diag(noise)
        for t in terms:
            x = columns[t].T.ravel()
            cov = cov + 0.7**2 * np.outer(x, x)
        return float(multivariate_normal(cov=cov).logpdf(y.T.ravel()))

    some = list(columns)
    for terms in ([some[0]], [some[1], some[2]], some):
        expected = density(terms) - density([]) - 1.5 * len(terms)
        assert problem.score(terms) - problem.score([]) == pytest.approx(expected)


def test_gains_and_losses_are_differences_of_scores(rng) -> None:
    problem, _, columns = problem_of(rng)
    a, b, tool = columns
    offers = [[b], [tool], [b, tool]]
    expected = [problem.score([a, *x]) - problem.score([a]) for x in offers]
    np.testing.assert_allclose(problem.gains([a], offers), expected)
    expected = [problem.score([a, b, tool]) - problem.score(x) for x in ([b, tool], [a, tool])]
    np.testing.assert_allclose(problem.losses([a, b, tool])[:2], expected)


def test_a_named_cause_takes_the_place_of_its_small_error(rng) -> None:
    problem, _, columns = problem_of(rng)
    a = next(iter(columns))
    problem.share(a._replace(small=True), a, np.array([0.1]))
    assert [t.small for t in problem.model([])] == [True]
    assert [t.small for t in problem.model([a])] == [False]
    gain = problem.score([a]) - problem.score([])
    np.testing.assert_allclose(problem.gains([], [[a]]), [gain])


def test_a_fold_that_is_left_out_takes_no_part(rng) -> None:
    problem, y, columns = problem_of(rng)
    terms = list(columns)
    before = problem.without(1).fit(terms)
    fold = np.arange(ROWS) % FOLDS
    other = problem_of(np.random.default_rng(3))[0]
    for k, channel in enumerate(other.channels):
        changed = np.where(fold == 1, 100.0, y[:, k])
        other.channels[k] = Channel(changed, fold, FOLDS)
        for number, term in enumerate(terms):
            if columns[term][:, k].any():
                other.channels[k].append(columns[term][None, :, k], [number])
        assert len(channel.at) == len(other.channels[k].at)
    np.testing.assert_allclose(other.without(1).fit(terms), before)
    assert not np.allclose(other.fit(terms), problem.fit(terms))


def test_bounds_are_kept_and_the_error_is_that_of_the_fit(rng) -> None:
    fold = np.zeros(ROWS, dtype=int)
    x = rng.normal(size=ROWS)
    y = -2 * x + 0.01 * rng.normal(size=ROWS)
    problem = Problem([Channel(y, fold, 1)], np.ones(1))
    term = Term("friction", 0)
    problem.add(term, {0: x[None]}, np.ones(1), (np.zeros(1), np.full(1, np.inf)), 0.0)
    assert problem.fit([term])[0] == 0
    assert problem.score([term]) < problem.score([])  # it only costs
    left = np.sum((y + 2 * x) ** 2)  # columns are kept in single precision
    np.testing.assert_allclose(problem.errors([term], np.array([-2.0])), left, rtol=1e-5)


def test_the_posterior_of_what_no_row_shows_is_the_prior(rng) -> None:
    problem, _, _ = problem_of(rng)
    hidden = Term("hidden", 0)
    problem.add(hidden, {0: np.full((1, ROWS), 1e-9)}, np.array([3.0]), FREE, 0.0)
    assert problem.covariance([hidden])[0, 0] == pytest.approx(9.0)


def test_weights_are_inverse_variances(rng) -> None:
    problem, y, columns = problem_of(rng)
    a = next(iter(columns))
    weight = rng.uniform(0.5, 2.0, (ROWS, 2))
    problem.reweigh(weight)
    x = columns[a][:, 0]
    expected = (weight[:, 0] * x) @ y[:, 0] / ((weight[:, 0] * x) @ x + 1 / 0.7**2)
    np.testing.assert_allclose(problem.fit([a]), [expected])
