"""The search on problems whose best model is known."""

import numpy as np

from stiction_envs.gap.judge.problem import ARM, Channel, Problem, Term
from stiction_envs.gap.judge.search import NAMED, Search

ROWS, JOINTS, NOISE = 400, 5, 0.1
FREE = (np.full(1, -np.inf), np.full(1, np.inf))


def search_for(truth: dict[Term, float], seed: int = 0, whole: str = "unit") -> Search:
    """Return a search among a cause of each joint, another with like columns, and one of all.

    ``whole`` names the last of them.
    """
    rng = np.random.default_rng(seed)
    fold = np.arange(ROWS) % 2
    x = rng.normal(size=(ROWS, JOINTS))
    like = x + 0.3 * rng.normal(size=x.shape)
    columns = {Term("right", j): {j: x[None, :, j]} for j in range(JOINTS)}
    columns |= {Term("like", j): {j: like[None, :, j]} for j in range(JOINTS)}
    columns[Term(whole, ARM)] = {j: x[None, :, j] for j in range(JOINTS)}
    y = NOISE * rng.normal(size=x.shape)
    for term, value in truth.items():
        for j, column in columns[term].items():
            y[:, j] += value * column[0]
    problem = Problem([Channel(c, fold, 2) for c in y.T], np.full(JOINTS, NOISE**2))
    for term, mine in columns.items():
        problem.add(term, mine, np.ones(1), FREE, float(np.log(len(columns))))

    def refresh(p: Problem, terms) -> float:
        return p.score(terms)

    return Search(problem, list(columns), lambda name: (), refresh)


def test_nothing_is_named_in_noise() -> None:
    assert search_for({}).climb([]).terms == ()


def test_the_right_causes_are_named_from_any_start() -> None:
    truth = {Term("right", 0): 0.3, Term("right", 2): -0.2}
    search = search_for(truth)
    for start in ([], [Term("like", 0)], [Term("like", 1), Term("unit", ARM)]):
        assert set(search.climb(start).terms) == set(truth)


def test_equal_causes_of_all_joints_are_one() -> None:
    search = search_for({Term("unit", ARM): 0.5})
    model = search.climb([Term("right", j) for j in range(JOINTS)])
    assert model.terms == (Term("unit", ARM),)


def test_a_cause_of_some_joints_is_not_one_of_all_that_the_others_take_back() -> None:
    truth = {Term("right", 0): 0.5, Term("right", 1): 0.5}
    others = [Term("right", j) for j in range(2, JOINTS)]
    model = search_for(truth, whole="right").climb([Term("right", ARM), *others])
    assert set(model.terms) == set(truth)


def test_rivals_say_how_sure_a_name_is() -> None:
    right = Term("right", 0)
    search = search_for({right: 0.3})
    best = search.problem.score([right])
    rivals = {model[-1].cause: best - score for score, model in search.rivals([right], [right])}
    assert set(rivals) == {"like", "unit"}
    assert all(nats > NAMED for nats in rivals.values())


def test_an_impossible_value_is_not_kept() -> None:
    right = Term("right", 0)
    search = search_for({right: 0.3})
    search.possible = lambda problem, terms, asked: [t.cause != "right" for t in asked]
    assert right not in search.climb([right]).terms
