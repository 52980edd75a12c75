"""What is said of a model of joint logs: causes, who takes how much, what is not shown."""

from collections.abc import Sequence

import numpy as np

from stiction_envs.arrays import Array, rms
from stiction_envs.gap.causes.base import ALL_LINKS
from stiction_envs.gap.causes.log.torque_scale import TorqueScale
from stiction_envs.gap.doubt import Draws
from stiction_envs.gap.judge.judgement import WIDTH, Estimate, NamedCause, NotShown, percent_lost
from stiction_envs.gap.judge.problem import ARM, LINKS, Term
from stiction_envs.gap.judge.search import Search
from stiction_envs.gap.predictors.judged import Judged, search_of

ALIKE = 3.0
"""Nats within which two causes are confused."""
MOST_ALIKE = 3
"""Number of causes with which one is said to be confused."""
MINOR = 1.0
"""Part of the nominal error below which a cause is minor [%]; assumed."""
EDGE = 1.02
"""A nonlinear parameter within this factor of the last value tried is at the end [-]; assumed."""
HIDDEN = 0.5
"""Standard deviation of a posterior over the prior's from which on data do not show it [-]."""


def named_causes(
    judged: Judged, drawn: Draws
) -> tuple[tuple[NamedCause, ...], tuple[NamedCause, ...]]:
    """Return the named causes, strongest first, and the minor ones.

    Args:
        judged: the model.
        drawn: draws of its posterior.
    """
    predictor, model = judged.predictor, judged.model
    problem, search = predictor.problem, search_of(predictor)
    now, some = problem.score(model.terms), predictor.data.measured
    nominal, in_newton_metres = rms(predictor.data.logged_residual), rms(predictor.data.residual)
    full = _left(judged, judged.coefficients)
    parts = problem.split(judged.terms, judged.coefficients)
    own, out, lost = dict(zip(judged.terms, parts, strict=True)), [], {}
    for name in dict.fromkeys(t.cause for t in model.terms):
        mine = [t for t in model.terms if t.cause == name]
        rest = list(model.terms)
        for term in mine:
            rest = search.without(rest, term)
        sizes = [len(problem.numbers[t]) for t in judged.terms]
        others = np.repeat([float(t not in mine) for t in judged.terms], sizes)
        without = _left(judged, judged.coefficients * others)
        nats, rivals = now - problem.score(rest), list[tuple[str, float]]()
        if name == TorqueScale.name and predictor.data.converted:
            without = _left(judged, judged.coefficients * others, logged=True)
            nats = _against_newton_metres(judged, mine)
        else:
            rivals = _rivals(search, model.terms, mine, now)
        # a thousand times the torque, in mN·m, would make every other cause a minor one
        lost[name] = percent_lost(*(x[some] for x in (without, full, in_newton_metres)))
        joints = tuple(sorted(t.joint + 1 for t in mine))
        if any(t.joint == ARM for t in mine):
            joints = tuple(range(1, predictor.data.n + 1))
        worst = int(np.argmax((without - full) / np.maximum(without, 1e-300)))
        what = predictor.causes[name].describe(predictor.data, own[mine[0]], mine[0].shape)
        out.append(
            NamedCause(
                name=name,
                joints=joints,
                gain_percent=percent_lost(*(x[some] for x in (without, full, nominal))),
                parameters={t.joint + 1: _estimates(judged, t, own[t], drawn) for t in mine},
                nats=nats,
                rivals=tuple(rivals),
                evidence=(
                    f"{what}: without it joint {worst + 1} is off by {without[worst]:.3g} N·m "
                    f"(root mean square), with it by {full[worst]:.3g} N·m"
                ),
                confused_with=tuple(x for x, nats in rivals if nats < ALIKE)[:MOST_ALIKE],
            )
        )
    out.sort(key=lambda x: -x.gain_percent)
    minor = [c for c in out[1:] if lost[c.name] < MINOR]
    return tuple(c for c in out if c not in minor), tuple(minor)


def _rivals(
    search: Search, terms: Sequence[Term], mine: Sequence[Term], now: float
) -> list[tuple[str, float]]:
    """Return the causes that could take the place of one, each with its nats, nearest first.

    A cause of several joints has the rivals that one joint allows, or those of all of it together.
    """
    best: dict[str, float] = {}
    for some in [[t] for t in mine] + ([list(mine)] if len(mine) > 1 else []):
        for score, model in search.rivals(terms, some):
            name = model[-1].cause
            best[name] = min(best.get(name, np.inf), now - score)
    return sorted(best.items(), key=lambda x: x[1])[: 2 * MOST_ALIKE]


def _estimates(judged: Judged, term: Term, mine: Array, drawn: Draws) -> dict[str, Estimate]:
    """Return the parameters of a term of coefficients (k,) with their 95 % intervals."""
    predictor = judged.predictor
    cause = predictor.causes[term.cause]
    samples = [cause.values(x, shape) for x, shape in drawn[judged.terms.index(term)]]
    data, grid = predictor.data, cause.grid(predictor.data, term.joint)
    on_bound = not cause.possible(data, term.joint, mine, term.shape, np.inf)
    if len(grid) and term.shape:  # refined parameters come close to the end without reaching it
        on_bound |= not grid[0] * EDGE < term.shape[0] < grid[-1] / EDGE
    out = {}
    for key, value in cause.values(mine, term.shape).items():
        ends: object = [value, value]
        if not isinstance(value, int):  # a choice among a few is no quantity
            ends = np.percentile([x[key] for x in samples], [2.5, 97.5], axis=0).T.tolist()
        out[key] = Estimate(value=value, ci95=ends, on_bound=on_bound)
    return out


def _left(judged: Judged, c: Array, *, logged: bool = False) -> Array:
    """Return (n,) error of a model on all rows, root mean square [N·m].

    ``logged`` takes the torques as they were logged, in their unit.
    """
    data = judged.predictor.data
    residual = data.logged_residual if logged else data.residual
    return rms(residual - judged.predictor.torque(judged.terms, c))


def _against_newton_metres(judged: Judged, gains: Sequence[Term]) -> float:
    """Return the evidence that torques were not logged in N·m, by Laplace's approximation [nats].

    Args:
        judged: the model.
        gains: its terms of the torques' gain.
    """
    problem, terms = judged.predictor.problem, judged.terms
    covariance = problem.covariance(terms)
    start = np.cumsum([0, *(len(problem.numbers[t]) for t in terms)])
    at = [int(start[terms.index(t)]) for t in gains]
    unit = np.array([(t.shape or (1.0,))[0] for t in gains])
    away = judged.coefficients[at] - (1 / unit - 1)
    return float(away @ np.linalg.solve(covariance[np.ix_(at, at)], away) / 2)


def shares(judged: Judged) -> dict[str, float]:
    """Return what takes how much off the nominal error, mean over joints [%].

    The named causes' torque is taken off first, then that of the links' small errors, then that of
    the set-up's.
    """
    data = judged.predictor.data
    torques = judged.predictor.torques(judged.terms, judged.coefficients)
    kinds = {
        "named": [x for t, x in torques.items() if not t.small],
        "links": [x for t, x in torques.items() if t.shape == LINKS],
        "set_up": [x for t, x in torques.items() if t.small and t.shape != LINKS],
    }
    left = np.array(data.residual)
    nominal = np.maximum(rms(data.logged_residual), 1e-300)
    out, before = dict[str, float](), np.ones(data.n)
    for kind, some in kinds.items():
        left -= np.sum([np.zeros_like(left), *some], axis=0)
        now = rms(left) / nominal
        out[kind] = float(100 * np.mean((before - now)[data.measured]))
        before = now
    return {**out, "left": float(100 * np.mean(before[data.measured]))}


def not_shown(judged: Judged) -> tuple[NotShown, ...]:
    """Return the linear causes whose posterior beside the model is about as wide as their prior."""
    predictor = judged.predictor
    problem, have = predictor.problem, {t[:2] for t in judged.model.terms}
    wide: dict[str, dict[int, dict[str, tuple[float, float]]]] = {}
    shown = {t[:2]: t for t in reversed(predictor.candidates)}
    for cause in predictor.causes.values():
        if (
            cause.adds_to == ALL_LINKS
            or not cause.is_linear
            or not any(p.size for p in cause.parameters)
        ):
            continue
        for joint in cause.joints(predictor.data):
            if (cause.name, joint) in have:
                continue
            key, first = cause.parameters[0].name, cause.parameters[0].neutral
            term = shown.get((cause.name, joint))
            j = max(joint, 0)
            first_shape = cause.shapes(predictor.data, j, predictor.data.residual[:, j])[0]
            shape = term.shape if term else first_shape
            sd = float(cause.prior(predictor.data, joint, shape).size[0])
            mean = 0.0
            if term:
                terms = problem.model([*judged.model.terms, term])
                k = len(problem.numbers[term])
                mean = float(problem.fit(terms)[-k])
                least, most = problem.bounds[term]
                if not least[0] < mean < most[0]:
                    continue  # the data say that there is none
                posterior = float(np.sqrt(problem.covariance(terms)[-k, -k]))
                if posterior < HIDDEN * sd:
                    continue
                sd = posterior
            low, high = (first + mean + x * WIDTH * sd for x in (-1, 1))
            wide.setdefault(cause.name, {})[joint] = {key: (low, high)}
    out = []
    for name, each in wide.items():
        if ARM in each:
            out.append(NotShown(name=name, joints=(), parameters=each[ARM]))
            continue
        joints = tuple(j + 1 for j in each)
        widest = max(each.values(), key=lambda x: next(np.ptp(v) for v in x.values()))
        out.append(NotShown(name=name, joints=joints, parameters=widest))
    return tuple(out)
