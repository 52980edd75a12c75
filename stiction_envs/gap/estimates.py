"""Parameters of the significant causes: refinement and block-bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from stiction_envs.gap.causes import Cause
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.linear.bounded_fit import solve
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.linear.joint_grams import JointGrams
from stiction_envs.gap.linear.model_columns import ModelColumns
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.settings import EstimateSettings

Array = NDArray[np.float64]
FAR = 5.0
"""Number of robust standard deviations at which resamples are clipped [-]; assumed."""
RESIZED = 2
"""Number of rounds in which nonlinear parameters are adapted to sizes [-]; assumed."""
RESIZED_REACH = 0.15
"""Size of the later changes of a parameter's logarithm [-]; assumed."""
TANGENT = 0.1
"""Step in the logarithm of a nonlinear parameter for its tangent [-]; assumed."""


def sharpen(library: RegressorLibrary, terms: list[Candidate]) -> list[Candidate]:
    """Refine nonlinear parameters between the grid's neighbours, and adapt them to the sizes found.

    Parameters that depend on a size are computed anew with it, `RESIZED` times.
    """
    out = _refined(library, terms)
    for _ in range(RESIZED):
        c = library.split(out, library.grams.fit(library.model_columns(out)))
        level = library.data.friction.level.copy()
        for term, mine in zip(out, c, strict=True):
            level[term.joint] += library.causes[term.cause].dry_friction(mine)
        larger = [
            t._replace(shape=library.causes[t.cause].resized(t.shape, x, float(level[t.joint])))
            for t, x in zip(out, c, strict=True)
        ]
        if larger == out:
            break
        library.refine(larger)
        out = _refined(library, larger, RESIZED_REACH)
    return out


def _refined(
    library: RegressorLibrary, terms: list[Candidate], near: float | None = None
) -> list[Candidate]:
    """Refine nonlinear parameters one after the other, within ``near`` or the grid's neighbours."""
    out = list(terms)
    c = library.split(out, library.grams.fit(library.model_columns(out)))
    for i, term in enumerate(out):
        if term.shape and term.joint != ARM and library.causes[term.cause].refinable:
            out[i] = _refined_term(library, out, c, i, near)
    library.refine(t for t in out if t not in terms)
    return out


def _refined_term(
    library: RegressorLibrary, terms: list[Candidate], c: list[Array], i: int, near: float | None
) -> Candidate:
    """Refine the first nonlinear parameter of a term; linear ones on its joint are fitted anew."""
    data, term = library.data, terms[i]
    cause, j, rest = library.causes[term.cause], term.joint, term.shape[1:]
    if near is None:
        ends = np.log(cause.between(term.shape, library.tried(term)))
    else:
        ends = np.log(term.shape[0]) + np.array([-near, near])
    left, fixed, bounds = data.residual[:, j].copy(), [], []
    for k, other in enumerate(terms):
        if k == i or j not in library.affected_joints(other):
            continue
        if library.affected_joints(other) == [j] and not other.small:
            fixed.append(library.columns(other, j))
            # another term may be refined already, and not yet be in the library
            own = library.causes[other.cause].bounds(data, j)
            bounds.append((own[0][: fixed[-1].shape[1]], own[1][: fixed[-1].shape[1]]))
        else:
            left -= library.part(other, j, c[k])
    bounds.append(library.bounds(term))
    low, high = (np.concatenate([b[side] for b in bounds]) for side in (0, 1))
    weight = library.weight[:, j] * (data.block >= 0)

    def moved(log: float) -> Candidate:
        return Candidate(term.cause, j, (float(np.exp(log)), *rest))

    def loss(log: float) -> float:
        x = np.concatenate([*fixed, library.columns(moved(log), j)], axis=1)
        xx, xr = x.T @ (x * weight[:, None]), x.T @ (left * weight)
        best = solve(xx, xr, low, high)
        return float(best @ xx @ best - 2 * xr @ best)

    found = minimize_scalar(
        loss, bounds=tuple(ends), method="bounded", options={"xatol": 0.005, "maxiter": 20}
    )
    return moved(found.x) if found.fun < loss(float(np.log(term.shape[0]))) else term


def estimates(
    library: RegressorLibrary,
    terms: list[Candidate],
    mine: list[Candidate],
    c: Array,
    draws: Draws | None,
) -> dict[int, dict[str, Estimate]]:
    """Return the parameters of one cause with intervals of the block bootstrap."""
    own = library.data.settings
    out: dict[int, dict[str, Estimate]] = {}
    for i, (term, best) in enumerate(zip(terms, library.split(terms, c), strict=True)):
        if term not in mine:
            continue
        cause = library.causes[term.cause]
        values = cause.values(best, term.shape)
        drawn = draws[i] if draws is not None else [(best, term.shape)]
        samples = [cause.values(x, shape) for x, shape in drawn]
        neutral = {p.name: p.neutral for p in cause.parameters}
        ends, is_open = _profiled(library, terms, term, c)
        reached = [cause.values(best, (x, *term.shape[1:])) for x in ends]
        bound = (
            is_open
            or cause.on_bound(best, library.data, term.joint)
            or cause.at_edge(term.shape, library.tried(term), own.candidates.edge)
        )
        out[term.joint + 1] = {
            key: Estimate(
                value=value,
                ci95=[value, value]
                if isinstance(value, int)  # a choice among a few, not a quantity
                else _interval(
                    np.array([x[key] for x in samples]),
                    np.array(value),
                    neutral.get(key, 0.0),
                    own.estimates,
                    [np.array(x[key]) for x in reached],
                ),
                on_bound=bound,
            )
            for key, value in values.items()
        }
    return out


def _profiled(
    library: RegressorLibrary, terms: list[Candidate], term: Candidate, c: Array
) -> tuple[list[float], bool]:
    """Return the ends of the profile-likelihood interval of a term, and whether one is open.

    The error with a given parameter, with the best of all others, may exceed the least error by the
    factor 1 + F(1, B − 1)/(B − 1) (Seber and Wild, "Nonlinear Regression", 1989, chapter 5): the
    remaining error is model error, one value in each of B blocks, and not noise from row to row.
    Empty for a cause without its own `profile`.
    """
    data, j = library.data, term.joint
    cause = library.causes[term.cause]
    if type(cause).profile is Cause.profile:
        return [], False
    others = library.own(terms, [t for t in terms if t != term])
    residual = data.residual[:, j] - library.torque(terms, c * others, j)
    weight = library.weight[:, j] * (data.block >= 0)
    at, left = cause.profile(data, j, term.shape, residual, weight)
    allowed = 1 + data.settings.estimates.interval**2 / max(data.blocks - 1, 1)
    inside = np.flatnonzero(left <= allowed * left.min())
    first, last = int(inside[0]), int(inside[-1])
    return [float(at[first]), float(at[last])], first == 0 or last == len(at) - 1


def _interval(
    samples: Array, value: Array, neutral: float, s: EstimateSettings, reached: Sequence[Array] = ()
) -> list[float] | list[list[float]]:
    """Return [low, high] about a value, or one pair per number; it contains ``reached``.

    The interval uses Student's t with as many degrees of freedom as blocks, since percentiles of 12
    blocks are too narrow, and is widened by the error of any model (``model_error``). Outliers,
    such as a quotient whose divisor came near zero, count as ``far`` deviations.
    """
    spread = s.interval * near(samples).std(axis=0) + s.model_error * np.max(
        np.abs(value - neutral)
    )
    low = np.stack([value - spread, *reached]).min(axis=0)
    high = np.stack([value + spread, *reached]).max(axis=0)
    return np.stack([low, high], axis=-1).tolist()


def near(samples: Array) -> Array:
    """Return resamples (R, ...) of which outliers count as `FAR` deviations."""
    low, middle, high = np.percentile(samples, [16, 50, 84], axis=0)
    far = FAR * (high - low) / 2
    return np.asarray(np.clip(samples, middle - far, middle + far))


Draws = list[list[tuple[Array, tuple[float, ...]]]]
"""For each term its (coefficients, nonlinear parameters) of every resample."""


def draw(library: RegressorLibrary, terms: list[Candidate], c: Array, seed: int) -> Draws:
    """Return resamples of the blocks, in which nonlinear parameters move along their tangents."""
    data, s = library.data, library.data.settings.estimates
    parts = library.split(terms, c)
    start = np.cumsum([0, *(len(x) for x in parts)])
    bent = [i for i, t in enumerate(terms) if t.shape and library.causes[t.cause].refinable]
    where = {i: int(start[-1]) + k for k, i in enumerate(bent)}
    size = int(start[-1]) + len(bent)
    grams, columns, coefficients = [], [], []
    for j in range(data.n):
        stacked: list[Array] = []
        at: list[int] = []
        for i, term in enumerate(terms):
            if j not in library.affected_joints(term):
                continue
            stacked.append(library.columns(term, j))
            at += range(start[i], start[i + 1])
            if i in where:
                up, down = (
                    Candidate(term.cause, term.joint, (term.shape[0] * np.exp(x), *term.shape[1:]))
                    for x in (TANGENT, -TANGENT)
                )
                slope = (library.columns(up, j) - library.columns(down, j)) / (2 * TANGENT)
                stacked.append((slope @ parts[i])[:, None])
                at.append(where[i])
        x = np.concatenate(stacked, axis=1) if stacked else np.zeros((len(data.t), 0))
        weight = library.weight[:, j] / data.noise[j] ** 2
        grams.append(Gram.of(x, data.residual[:, j], data.block, weight, data.blocks))
        columns.append(tuple(range(x.shape[1])))
        coefficients.append(tuple(at))
    low, high, sd = np.full(size, -np.inf), np.full(size, np.inf), np.full(size, np.inf)
    for i, term in enumerate(terms):
        mine = slice(start[i], start[i + 1])
        low[mine], high[mine] = library.bounds(term)
        sd[mine] = library.prior(term)
    firm = np.square(1 / sd)
    model = ModelColumns(tuple(columns), tuple(coefficients), tuple(low), tuple(high), tuple(firm))
    rng = np.random.default_rng(seed)
    draws = JointGrams(grams, library.inflation).resample(model, s.resamples, rng, sd)
    out: Draws = []
    for i, term in enumerate(terms):
        own = draws[:, start[i] : start[i + 1]]
        shapes = [term.shape] * len(own)
        if i in where:
            moved = np.clip(draws[:, where[i]] - np.median(draws[:, where[i]]), -1, 1)
            shapes = [(float(term.shape[0] * np.exp(m)), *term.shape[1:]) for m in moved]
        out.append(list(zip(own, shapes, strict=True)))
    return out
