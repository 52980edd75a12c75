"""The judgement of joint logs: the best model, found in rounds, and how sure it is.

What a payload weighs changes the load of the gears, a delay shifts friction too, and nonlinear
parameters are best proposed in what the rest of a model leaves. So the search is repeated with the
columns as they are given the model of the round before, until its causes stay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from stiction_envs.arrays import Array
from stiction_envs.gap.causes import Cause
from stiction_envs.gap.causes.base import DRY, FRICTION, GRAVITY, OF_ARM
from stiction_envs.gap.causes.body.bodies import leaned
from stiction_envs.gap.causes.friction.presliding_hysteresis import PreslidingHysteresis
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.causes.log.torque_scale import TorqueScale
from stiction_envs.gap.doubt import Draws
from stiction_envs.gap.judge.judgement import WIDTH
from stiction_envs.gap.judge.problem import ARM, Term
from stiction_envs.gap.judge.search import NAMED, Model, Search
from stiction_envs.gap.links import with_found_links
from stiction_envs.gap.predictors.torque import FOLDS, PARTS, TorquePredictor
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import presliding_distances

ROUNDS = 4
"""Largest number of searches, each with the columns given the model before [-]; assumed."""
STARTS = (0.1, 1.0)
"""Sizes of the small errors from which searches start [-]; assumed: links exact, and usual ones."""
TANGENT = 0.05
"""Step in the logarithm of a nonlinear parameter for its tangent [-]; assumed."""
SAME = 1e-9
"""Part of a nonlinear parameter within which two are the same [-]; assumed."""
TANGENT_SD = 1.0
"""Prior standard deviation of that logarithm about the grid's best [-]; assumed."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The best model of joint logs."""

    predictor: TorquePredictor
    model: Model
    terms: list[Term]
    """Small errors, friction that is not named, then the named terms."""
    coefficients: Array
    """(P,)."""


def search_of(predictor: TorquePredictor, fold: int = -1, *, resizes: bool = True) -> Search:
    """Return the search among a predictor's candidates, without a fold of the rows.

    ``resizes`` says whether the small errors take the size that a model leaves them.
    """
    problem = predictor.problem if fold < 0 else predictor.problem.without(fold)
    refresh = partial(predictor.refresh, resizes=resizes)
    return Search(problem, predictor.candidates, predictor.needs, refresh, predictor.possible)


def climbed(
    predictor: TorquePredictor, search: Search, start: Sequence[Term], *, swaps: bool = True
) -> Model:
    """Return the model that a search reaches, at first as if errors of the model did not last.

    What the model lacks at the start would else count as an error that lasts, and stay out.
    """
    often, predictor.repeats = predictor.repeats, np.ones_like(predictor.repeats)
    if (often > 1).any():
        start = search.climb(start, swaps=False).terms
        predictor.repeats = often
    return search.climb(start, swaps=swaps)


def plain_friction(predictor: TorquePredictor) -> list[Term]:
    """Return dry and viscous friction of every joint: a usual start of a search."""
    return [
        t
        for t in predictor.candidates
        if predictor.causes[t.cause].adds_to in FRICTION and t.part == PARTS[0]
    ]


def judge(
    data: Data, causes: Sequence[Cause], say: Callable[[str, float], None] = lambda *_: None
) -> Judged:
    """Return the model with the most evidence.

    Args:
        data: the logs.
        causes: hypotheses.
        say: called with a stage and the part of it that is done.
    """
    say("columns of all causes", 0.0)
    predictor = TorquePredictor(data, causes)
    say("choosing causes", 0.0)
    best = sharpened(predictor, _expected(predictor, _first(predictor)))
    for k in range(1, ROUNDS):
        say("choosing causes", k / ROUNDS)
        named = [t for t in best.terms if predictor.causes[t.cause].adds_to in OF_ARM or t.shape]
        if not named:
            break
        after, start = _given(predictor, best, data, causes)
        before = after.refresh(after.problem, start)
        found = sharpened(after, climbed(after, search_of(after), start))
        if found.evidence < best.evidence - NAMED:  # far off, columns of a model may mislead
            break
        # the mass of a body depends on a tilt, and the tilt that is found on the body
        (lean, doubt), (now, _) = _lean(predictor, best), _lean(after, found)
        predictor, best = after, found
        if found.evidence < before + NAMED and (np.abs(now - lean) <= doubt).all():
            break
    best = _clear(predictor, best)
    if data.converted:
        best = _in_unit(predictor, best)
    terms = predictor.whole(predictor.problem, best.terms)
    return Judged(predictor, best, terms, predictor.problem.fit(terms))


def _clear(predictor: TorquePredictor, model: Model) -> Model:
    """Return the model without causes whose first parameter's interval contains zero.

    A cause may be likely for its other parameters: a body for its inertia, without a mass.
    """
    problem, named = predictor.problem, list(model.terms)
    while named:
        terms = problem.model(named)
        sd = np.sqrt(np.diag(problem.covariance(terms)))
        parts, doubts = problem.split(terms, problem.fit(terms)), problem.split(terms, sd)
        size = {}
        for term, c, doubt in zip(terms, parts, doubts, strict=True):
            first = predictor.causes[term.cause].parameters[0].size or len(c)
            size[term] = float(np.max(np.abs(c[:first]) / doubt[:first]))
        worst = min(named, key=lambda t: size[t])
        if size[worst] > WIDTH:
            break
        named = search_of(predictor).without(named, worst)
    if len(named) == len(model.terms):
        return model
    evidence = predictor.refresh(problem, named)
    return Model(tuple(named), problem.scales, problem.inflation.copy(), evidence)


def _in_unit(predictor: TorquePredictor, model: Model) -> Model:
    """Return the model with the gain of torques in another unit, on the arm or on each joint.

    The logs were converted by a rough factor. The gain is in the model even where that is right.
    """
    problem = predictor.problem
    rest = [t for t in model.terms if t.cause != TorqueScale.name or not t.shape]
    offered = [t for t in predictor.candidates if t.cause == TorqueScale.name and t.shape]
    gains = {t.joint: t for t in reversed(offered)}
    each = [*rest, *(t for j, t in gains.items() if j != ARM)]
    terms = each
    if ARM in gains:
        arm = [*rest, gains[ARM]]
        less = problem.score(each) - problem.score(arm)
        terms = arm if less < NAMED * (len(each) - len(arm)) else each
    evidence = predictor.refresh(problem, terms)
    return Model(tuple(terms), problem.scales, problem.inflation.copy(), evidence)


def gains(predictor: TorquePredictor, terms: Sequence[Term], c: Array) -> Array:
    """Return (n, ...) gain of each joint's torque in a model with coefficients (..., P)."""
    out = np.ones((predictor.data.n, *c.shape[:-1]))
    for term, mine in zip(terms, predictor.problem.split(terms, c), strict=True):
        if term.cause == TorqueScale.name and not term.small:
            out[slice(None) if term.joint == ARM else term.joint] += mine[..., 0]
    return out


def _first(predictor: TorquePredictor) -> Model:
    """Return the best model that searches with small errors of several sizes reach."""
    problem, found = predictor.problem, list[Model]()
    for size in STARTS[1:] if predictor.links_known else STARTS:
        problem.given(np.full(predictor.data.n, predictor.rows), (size, size))
        found.append(_freed(predictor, plain_friction(predictor)))
    best = max(found, key=lambda m: m.evidence)
    problem.given(best.inflation, best.scales)
    return climbed(predictor, search_of(predictor), best.terms)


def _lean(predictor: TorquePredictor, model: Model) -> tuple[Array, Array]:
    """Return the gravity (2,) that a model adds sideways, and its standard deviations [m/s²]."""
    problem = predictor.problem
    terms = problem.model(model.terms)
    sd = np.sqrt(np.diag(problem.covariance(terms)))
    parts = zip(
        terms, problem.split(terms, problem.fit(terms)), problem.split(terms, sd), strict=True
    )
    each = [(c, d) for t, c, d in parts if predictor.causes[t.cause].adds_to == GRAVITY]
    return each[-1] if each else (np.zeros(2), np.zeros(2))


def _expected(predictor: TorquePredictor, model: Model) -> Model:
    """Return the model with the likeliest size of what no model has, and what is best then.

    How long errors last is measured here, on the model of a search as if errors did not last. A
    model that lacks a cause leaves errors that last, which would keep the cause out.
    """
    predictor.repeats = predictor.lasting(model)
    predictor.expect(predictor.problem, predictor.expected(model))
    return best_of(predictor, [model.terms, plain_friction(predictor)])


def best_of(predictor: TorquePredictor, starts: Sequence[Sequence[Term]]) -> Model:
    """Return the best model that searches from some starts reach, and set its noise and sizes.

    One large error among small ones raises the size of all of them. So the best model is searched
    on with small errors of the least size, under which the large one is named.
    """
    problem, search = predictor.problem, search_of(predictor)
    best = max((climbed(predictor, search, x) for x in starts), key=lambda m: m.evidence)
    small = (min(STARTS[0], best.scales[0]), min(STARTS[0], best.scales[1]))
    if small != best.scales:
        problem.given(best.inflation, small)
        found = _freed(predictor, best.terms)
        if found.evidence > best.evidence and found.worth > best.worth:
            best = found
    problem.given(best.inflation, best.scales)
    return best


def _freed(predictor: TorquePredictor, start: Sequence[Term]) -> Model:
    """Return the model of a search with the given sizes of the small errors, then with any."""
    model = climbed(predictor, search_of(predictor, resizes=False), start, swaps=False)
    return climbed(predictor, search_of(predictor), model.terms, swaps=False)


def _given(
    predictor: TorquePredictor, model: Model, data: Data, causes: Sequence[Cause]
) -> tuple[TorquePredictor, list[Term]]:
    """Return the predictor with columns as they are given a model, and its terms there.

    ``data`` and ``causes`` are those before anything was given.
    """
    problem = predictor.problem
    terms = problem.model(model.terms)
    c = problem.fit(terms)
    torques, own = predictor.torques(terms, c), predictor.causes
    shares = dict(zip(terms, problem.split(terms, c), strict=True))
    bodies = [t for t in terms if own[t.cause].adds_to in OF_ARM]
    if bodies:
        leans = [shares[t][:2] for t in bodies if own[t.cause].adds_to == GRAVITY]
        side = np.sum([np.zeros(2), *leans], axis=0)
        gravity = leaned(data.recording.pinocchio.gravity.linear, side) if side.any() else ()
        arm = with_found_links(predictor, terms, c)
        load = np.sum([torques[t] for t in bodies], axis=0)
        data = data.carrying(load, tuple(float(x) for x in gravity), arm)
    sound = [
        t
        for t in terms
        if not isinstance(own[t.cause], ActuatorDelay) and not own[t.cause].resembles_delay
    ]
    late = data.nominal + np.sum([torques[t] for t in sound], axis=0)
    lengths = [float(shares[t][0]) for t in terms if isinstance(own[t.cause], ActuatorDelay)]
    given = [x.acting_on(late, lengths) if isinstance(x, ActuatorDelay) else x for x in causes]
    if not data.has_friction:
        # a bristle beside dry friction may only make up for a wrong presliding distance
        bristle = PreslidingHysteresis.name
        dry = [t for t in terms if own[t.cause].adds_to == DRY or t.cause == bristle]
        rest = np.sum([x for t, x in torques.items() if t not in dry], axis=0)
        data = data.with_presliding(presliding_distances(data.recording, data.residual - rest))
    after = TorquePredictor(data, given, torques)
    level = data.friction.level.copy()
    for t, mine in shares.items():
        level[t.joint] += float(mine[0]) if own[t.cause].adds_to == DRY else 0.0
    start = []
    for t in model.terms:
        shape = own[t.cause].resized(t.shape, shares[t], float(level[t.joint]))
        after.offer(own[t.cause], t.joint, [shape])
        start.append(t._replace(shape=tuple(float(x) for x in shape)))
    after.repeats = predictor.repeats
    after.expect(after.problem, predictor.expects)
    after.problem.given(model.inflation, model.scales)
    return after, [t for t in start if t in after.problem.numbers]


def sharpened(predictor: TorquePredictor, model: Model) -> Model:
    """Return the model with nonlinear parameters refined on its score, one after the other."""
    problem, terms = predictor.problem, list(model.terms)
    alone = problem.only(problem.model(terms))

    def moved(log: float, i: int) -> list[Term]:
        out = terms[i]._replace(shape=(float(np.exp(log)), *terms[i].shape[1:]))
        if out not in alone.numbers:
            predictor.add(alone, out._replace(part=PARTS[0]))
            alone.odds[out] = problem.odds[terms[i]]
        return [*terms[:i], out, *terms[i + 1 :]]

    def loss(log: float, i: int) -> float:
        return -alone.score(moved(log, i))

    for i, term in enumerate(model.terms):
        cause = predictor.causes[term.cause]
        grid = cause.grid(predictor.data, term.joint)
        if not term.shape or not len(grid):
            continue
        at = np.searchsorted(grid, [term.shape[0] * (1 - SAME), term.shape[0] * (1 + SAME)])
        ends = np.log([grid[max(at[0] - 1, 0)], grid[min(at[1], len(grid) - 1)]])
        options = {"xatol": 0.02, "maxiter": 8}
        found = minimize_scalar(
            loss, args=(i,), bounds=tuple(ends), method="bounded", options=options
        )
        if -found.fun > alone.score(terms):
            terms = moved(float(found.x), i)
            predictor.offer(cause, term.joint, [terms[i].shape])
            problem.odds[terms[i]] = problem.odds[term]
    if tuple(terms) == model.terms:
        return model
    evidence = predictor.refresh(problem, terms)
    return Model(tuple(terms), problem.scales, problem.inflation.copy(), evidence)


def held_out(judged: Judged, say: Callable[[float], None] = lambda _: None) -> Array:
    """Return (n,) error on rows that a model was neither chosen nor fitted with [N·m].

    Each fold is predicted by the search among the same candidates without it.
    """
    predictor, best = judged.predictor, judged.model
    data, total = predictor.data, np.zeros(predictor.data.n)
    for fold in range(FOLDS):
        say(fold / FOLDS)
        rows = predictor.fold == fold
        if not rows.any():
            continue
        search = search_of(predictor, fold)
        search.problem.given(best.inflation, best.scales)
        model = climbed(predictor, search, plain_friction(predictor), swaps=False)
        terms = predictor.whole(search.problem, model.terms)
        left = data.residual - predictor.torque(terms, search.problem.fit(terms))
        total += [float(np.square(x).sum()) for x in left[rows].T]
    return np.sqrt(total / max(int((predictor.fold >= 0).sum()), 1))


def draws(judged: Judged, count: int, seed: int) -> Draws:
    """Return ``count`` draws of (coefficients, nonlinear parameters) of each term's posterior.

    Nonlinear parameters move along their tangents.
    """
    predictor, terms = judged.predictor, judged.terms
    problem = predictor.problem
    if not terms:
        return []
    parts = problem.split(terms, judged.coefficients)
    alone, bent = problem.only(terms), dict[int, Term]()
    for i, (term, mine) in enumerate(zip(terms, parts, strict=True)):
        if not term.shape or not len(predictor.causes[term.cause].grid(predictor.data, term.joint)):
            continue
        beside = [(term.shape[0] * np.exp(x), *term.shape[1:]) for x in (TANGENT, -TANGENT)]
        up, down = predictor.rows_of([term._replace(shape=x) for x in beside])
        slope = {j: mine @ (up[j] - down[j])[: len(mine)] / (2 * TANGENT) for j in up}
        bent[i] = Term("tangent", i)
        free = np.full(1, np.inf)
        columns = {j: x[None] for j, x in slope.items()}
        alone.add(bent[i], columns, np.full(1, TANGENT_SD), (-free, free), 0.0)
    every = [*terms, *bent.values()]
    factor = np.linalg.cholesky(alone.covariance(every))
    rng = np.random.default_rng(seed)
    moved = rng.normal(size=(count, len(factor))) @ factor.T
    split = dict(zip(every, alone.split(every, moved), strict=True))
    doubt = np.ones((predictor.data.n, count))
    if predictor.data.converted:  # the sizes of all causes are as uncertain as the gain
        doubt = gains(predictor, terms, moved[:, : len(judged.coefficients)])
    out = []
    for i, (term, mine) in enumerate(zip(terms, parts, strict=True)):
        low, high = problem.bounds[term]
        own = np.clip(mine + split[term], low, high)
        if term.joint != ARM and term.cause != TorqueScale.name:
            own = own / doubt[term.joint][:, None]
        shapes = [term.shape] * count
        if i in bent:
            steps = np.exp(np.clip(split[bent[i]][:, 0], -1, 1))
            shapes = [(float(term.shape[0] * x), *term.shape[1:]) for x in steps]
        out.append(list(zip(own, shapes, strict=True)))
    return out
