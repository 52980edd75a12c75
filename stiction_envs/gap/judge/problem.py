"""Linear Gaussian models of measured channels, and their log evidence.

A channel (a joint's torque, a joint's angle, the cells of a table) is y = X c + e. The columns X
belong to terms: a cause on a joint with its nonlinear parameters. Every coefficient has a Gaussian
prior about zero, so the evidence of any choice of terms is a closed form of the sums XᵀWX, XᵀWy and
yᵀWy (C. Bishop, "Pattern Recognition and Machine Learning", 2006, 3.5). Bounds are kept by the fit;
the evidence of a model on a bound is that of Laplace's approximation at the bounded maximum.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dpotrs

from stiction_envs.arrays import Array, Index
from stiction_envs.gap.judge.bounded_fit import solve

ARM = -1
"""The joint's number of a `Term` of the whole arm."""
LINKS = (-1.0,)
"""Shape of the small errors of all links, which have a size of their own."""
DUPLICATE = 1e-6
"""Least part of its prior variance that a coefficient keeps beside its small error [-]."""


class Term(NamedTuple):
    """One cause on one joint (from 0), or on the whole arm, with its nonlinear parameters."""

    cause: str
    joint: int
    shape: tuple[float, ...] = ()
    small: bool = False
    """Whether it is an error within its tolerance: in every model, and never named."""
    part: float = 1.0
    """Size of its prior over the usual size of the cause [-]."""

    @property
    def aside(self) -> bool:
        """Whether it is of a finished model alone: what is there anyway, however little."""
        return self.small and self.part != 1.0


class Channel:
    """Rows of one measured signal, and the sums of its columns over each fold of them."""

    def __init__(self, residual: Array, fold: Index, folds: int) -> None:
        """Start without columns.

        Args:
            residual: (T,) measured less nominal.
            fold: (T,) number of the fold that is held out together; -1 for rows of none.
            folds: number of folds F.
        """
        self._rows = [np.flatnonzero(fold == f) for f in range(folds)]
        self._whole: dict[int, tuple[Array, Array, float]] = {}
        self.residual = residual
        self.weight = np.ones(len(residual))
        """(T,) one over the variance of each row."""
        self._blocks: dict[int, NDArray[np.floating]] = {}
        self.at = np.empty(0, dtype=np.int64)
        """(P,) number of each column's coefficient."""
        self.xx = np.empty((folds, 0, 0))
        """(F, P, P) sums of the first `_summed` columns."""
        self.xr = np.empty((folds, 0))
        """(F, P) sums with the residual."""
        self.rr = np.zeros(folds)
        """(F,) of the residual squared."""
        self.count = np.array([float(len(rows)) for rows in self._rows])
        """(F,) number of rows."""
        self._summed = 0
        self.reweigh(self.weight)

    def columns(self, at: Sequence[int] | Index) -> NDArray[np.floating]:
        """Return the columns (k, T) that were added together for coefficients ``at`` (k,)."""
        return self._blocks[int(at[0])]

    def only(self, numbers: Index) -> "Channel":
        """Return the channel with the columns of some coefficients alone."""
        out, some = copy.copy(self), set(numbers.tolist())
        out._blocks = {first: x for first, x in self._blocks.items() if first in some}
        out.at = self.at[np.isin(self.at, numbers)]
        out._whole, out._summed = {}, 0
        return out

    def append(self, columns: NDArray[np.floating], at: Sequence[int]) -> None:
        """Add columns (k, T) of coefficients ``at`` (k,); they are not copied."""
        self._blocks[int(at[0])] = columns
        self.at = np.append(self.at, np.asarray(at, dtype=np.int64))

    def reweigh(self, weight: Array) -> None:
        """Take other weights (T,) of the rows; all sums are computed anew."""
        self.weight = weight
        self.rr = np.array([float(weight[r] @ np.square(self.residual[r])) for r in self._rows])
        self._summed = 0
        self._whole.clear()

    def sums(self, held_out: int) -> tuple[Array, Array, float]:
        """Return XᵀWX (P, P), XᵀWr (P,) and rᵀWr over all folds but ``held_out`` (-1 for none)."""
        self._sum()
        if held_out not in self._whole:
            each = self.xx, self.xr, self.rr
            xx, xr, rr = (x.sum(axis=0) for x in each)
            if held_out >= 0:
                xx, xr, rr = xx - each[0][held_out], xr - each[1][held_out], rr - each[2][held_out]
            self._whole[held_out] = xx, xr, float(rr)
        return self._whole[held_out]

    def _sum(self) -> None:
        """Compute the sums of the columns that were added since the last time."""
        first, last = self._summed, len(self.at)
        if first == last:
            return
        self._summed = last
        self._whole.clear()
        xx, xr = self.xx[:, :first, :first], self.xr[:, :first]
        self.xx, self.xr = np.empty((len(xx), last, last)), np.empty((len(xr), last))
        self.xx[:, :first, :first], self.xr[:, :first] = xx, xr
        for f, rows in enumerate(self._rows):
            root, every, start = np.sqrt(self.weight[rows]), np.empty((last, len(rows))), 0
            for block in self._blocks.values():
                end = start + len(block)
                np.multiply(block[:, rows], root, out=every[start:end])
                start = end
            mine = every[first:]
            part = mine @ every.T  # numpy computes one triangle where both are the same
            self.xx[f, first:last, :last] = part
            self.xx[f, :last, first:last] = part.T
            self.xr[f, first:last] = mine @ (root * self.residual[rows])


@dataclass(eq=False)
class Problem:
    """All terms of a diagnosis, their columns on the channels, and their priors."""

    channels: list[Channel]
    inflation: Array
    """(C,) number of rows that form one independent observation, times the variance that a model
    leaves over the expected one."""
    always: list[Term] = field(default_factory=list)
    """Small errors, in every model."""
    scales: tuple[float, float] = (1.0, 1.0)
    """Sizes over their tolerance of the small errors of all links, and of the set-up [-]."""
    held_out: int = -1
    """Number of the fold that takes no part; -1 for none."""
    numbers: dict[Term, Index] = field(default_factory=dict)
    """Coefficients of each term."""
    odds: dict[Term, float] = field(default_factory=dict)
    """Log prior odds against each term [nats]."""
    bounds: dict[Term, tuple[Array, Array]] = field(default_factory=dict)
    """Lowest and highest coefficients of each term, (k,) each."""
    _sd: dict[Term, Array] = field(default_factory=dict)
    _count: int = 0
    _offers: dict[tuple[Term, ...], tuple[Index, Array, float]] = field(default_factory=dict)
    # what was computed of this problem alone: `replace` does not copy it
    _scores: dict[tuple[Term, ...], float] = field(default_factory=dict, init=False)
    _fits: dict[tuple[Term, ...], Array] = field(default_factory=dict, init=False)
    _sums: tuple[Array, Array, float] | None = field(default=None, init=False)
    _last: tuple[tuple[Term, ...], tuple[Array, Array, Array, Array]] | None = field(
        default=None, init=False
    )
    """The last model that was solved, and its solution."""

    # ---- terms -------------------------------------------------------------------------------

    def add(
        self,
        term: Term,
        columns: Mapping[int, NDArray[np.floating]],
        sd: Array,
        bounds: tuple[Array, Array],
        odds: float,
    ) -> None:
        """Add a term.

        Args:
            term: not there yet.
            columns: (k, T) of each channel on which it acts.
            sd: (k,) prior standard deviations of its coefficients.
            bounds: lowest and highest coefficients, (k,) each.
            odds: log prior odds against it [nats].
        """
        at = range(self._count, self._count + len(sd))
        self._count += len(sd)
        self.numbers[term] = np.array(at, dtype=np.int64)
        self._sd[term], self.bounds[term], self.odds[term] = sd, bounds, odds
        for channel, x in columns.items():
            self.channels[channel].append(x, at)
        if term.small:
            self.always.append(term)
        self._sums = None

    def share(self, other: Term, term: Term, sd: Array) -> None:
        """Add a term with the columns of another, and its own standard deviations (k,).

        A small error of every model has no bounds, and no odds against it.
        """
        free = np.full(len(sd), np.inf)
        self.numbers[other], self._sd[other] = self.numbers[term], sd
        self.bounds[other], self.odds[other] = self.bounds[term], self.odds[term]
        if other.small and not other.aside:
            self.bounds[other], self.odds[other] = (-free, free), 0.0
            self.always.append(other)

    def sd(self, term: Term) -> Array:
        """Return (k,) prior standard deviations of a term."""
        if not term.small or term.aside:
            return self._sd[term]
        return self._sd[term] * self.scales[0 if term.shape == LINKS else 1]

    def given(
        self, inflation: Array | None = None, scales: tuple[float, float] | None = None
    ) -> None:
        """Take another noise, or other sizes of the small errors; None leaves them."""
        if inflation is not None:
            self.inflation, self._sums = inflation, None
        if scales is not None:
            self.scales = scales
        self._forget()

    def reweigh(self, weights: Array) -> None:
        """Take other weights (T, C) of the rows."""
        for weight, channel in zip(weights.T, self.channels, strict=True):
            channel.reweigh(weight)
        self._sums = None
        self._forget()

    def _forget(self) -> None:
        """Forget what was computed of models."""
        self._scores.clear()
        self._fits.clear()
        self._last = None

    def without(self, fold: int) -> Self:
        """Return the problem without the rows of a fold; terms are shared."""
        return replace(self, held_out=fold)

    def only(self, terms: Sequence[Term]) -> Self:
        """Return a problem with the columns of some terms alone, to which others can be added."""
        out = replace(
            self,
            channels=[
                x.only(np.concatenate([self.numbers[t] for t in terms])) for x in self.channels
            ],
            always=[t for t in terms if t.small],
            numbers=dict(self.numbers),
            odds=dict(self.odds),
            _sd=dict(self._sd),
            bounds=dict(self.bounds),
        )
        out.reweigh(np.stack([x.weight for x in self.channels], axis=1))
        return out

    def model(self, named: Sequence[Term]) -> list[Term]:
        """Return the small errors that nothing named replaces, then the named terms."""
        have = {(t.cause, t.joint) for t in named}
        return [*(t for t in self.always if (t.cause, t.joint) not in have), *named]

    def split(self, terms: Sequence[Term], c: Array) -> list[Array]:
        """Return the coefficients (..., k) of each term."""
        ends = accumulate((len(self.numbers[t]) for t in terms), initial=0)
        return [c[..., a:b] for a, b in pairwise(ends)]  # numpy's own takes as long as the fit

    # ---- sums --------------------------------------------------------------------------------

    def counts(self) -> Array:
        """Return (C,) number of rows that take part."""
        each = [x.count for x in self.channels]
        return np.array([x.sum() - (x[self.held_out] if self.held_out >= 0 else 0) for x in each])

    def sums(self) -> tuple[Array, Array, float]:
        """Return XᵀWX, XᵀWr and rᵀWr of all coefficients, in independent observations."""
        if self._sums is None:
            xx, xr, rr = np.zeros(self._count**2), np.zeros(self._count), 0.0
            for channel, rows in zip(self.channels, self.inflation, strict=True):
                square, along, size = channel.sums(self.held_out)
                # one index into the flat matrix takes half the time of two
                flat = np.add.outer(self._count * channel.at, channel.at).ravel()
                xx[flat] += (square / rows).ravel()
                xr[channel.at] += along / rows
                rr += size / rows
            self._sums = xx.reshape(self._count, -1), xr, rr
        return self._sums

    def sums_of(self, terms: Sequence[Term]) -> tuple[Array, Array]:
        """Return XᵀWX (P, P) and XᵀWr (P,) of a model's coefficients."""
        at, (xx, xr, _) = self.at(terms), self.sums()
        return xx[np.ix_(at, at)], xr[at]

    def misfit(self, terms: Sequence[Term]) -> float:
        """Return rᵀWr with the noise of a model."""
        return self.sums()[2]

    def at(self, terms: Sequence[Term]) -> Index:
        """Return (P,) numbers of a model's coefficients."""
        return np.concatenate([self.numbers[t] for t in terms] or [np.empty(0, dtype=np.int64)])

    def _solved(self, terms: Sequence[Term]) -> tuple[Array, Array, Array, Array]:
        """Return a Cholesky factor of the posterior precision and the likeliest coefficients.

        Both are in units of the prior, with the gradient at zero and the coefficients' units.
        """
        if self._last is not None and self._last[0] == tuple(terms):
            return self._last[1]
        sd = np.concatenate([self.sd(t) for t in terms] or [np.empty(0)])
        xx, xr = self.sums_of(terms)
        a = xx * np.outer(sd, sd) + np.eye(len(sd))
        b = xr * sd
        root, failed = dpotrf(a, lower=True)  # scipy's wrappers take longer than the work
        if failed:
            raise np.linalg.LinAlgError("the posterior precision is not positive definite")
        c = dpotrs(root, b, lower=True)[0] if len(b) else b
        each = [self.bounds[t] for t in terms]
        low, high = (np.concatenate([x[k] for x in each] or [np.empty(0)]) / sd for k in (0, 1))
        if ((c < low) | (c > high)).any():
            c = solve(a, b, low, high, c)
        self._last = tuple(terms), (root, b, c, sd)
        return self._last[1]

    def fit(self, terms: Sequence[Term]) -> Array:
        """Return (P,) the likeliest coefficients of a model within bounds; not to be changed."""
        key = tuple(terms)
        if key not in self._fits:
            _, _, c, sd = self._solved(terms)
            self._fits[key] = c * sd
        return self._fits[key]

    def covariance(self, terms: Sequence[Term]) -> Array:
        """Return (P, P) posterior covariance of a model's coefficients."""
        root, _, _, sd = self._solved(terms)
        half = solve_triangular(root, np.diag(sd), lower=True)
        return np.asarray(half.T @ half)

    def errors(self, terms: Sequence[Term], c: Array) -> Array:
        """Return (C,) weighted squared error of a model with coefficients (P,)."""
        whole = np.zeros(self._count)
        whole[self.at(terms)] = c
        out = np.zeros(len(self.channels))
        for k, channel in enumerate(self.channels):
            mine = whole[channel.at]
            own = np.flatnonzero(mine)
            xx, xr, rr = channel.sums(self.held_out)
            some = mine[own]
            out[k] = rr - 2 * xr[own] @ some + some @ xx[np.ix_(own, own)] @ some
        return np.maximum(out, 0.0)

    # ---- evidence ----------------------------------------------------------------------------

    def score(self, named: Sequence[Term]) -> float:
        """Return log evidence and log prior odds of a model, given the noise [nats]."""
        key = tuple(named)
        if key not in self._scores:
            model = self.model(named)
            root, b, c, sd = self._solved(model)
            self._fits[tuple(model)] = c * sd
            moved = root.T @ c
            gained = 2 * b @ c - moved @ moved
            volume = 2 * float(np.log(np.diag(root)).sum())
            cost = sum(self.odds[t] for t in named)
            self._scores[key] = 0.5 * float(gained - volume - self.misfit(model)) - cost
        return self._scores[key]

    def losses(self, named: Sequence[Term]) -> Array:
        """Return (K,) by how much the removal of each of K named terms would lower the score.

        Without regard to bounds, and to the small errors that take a term's place.
        """
        terms = self.model(named)
        _, _, c, sd = self._solved(terms)
        covariance = self.covariance(terms) / np.outer(sd, sd)
        ends = np.cumsum([0, *(len(self.numbers[t]) for t in terms)])
        out = []
        for k in range(len(terms) - len(named), len(terms)):
            mine = slice(ends[k], ends[k + 1])
            own = covariance[mine, mine]
            value = c[mine] @ np.linalg.solve(own, c[mine]) + np.linalg.slogdet(own)[1]
            out.append(0.5 * float(value) - self.odds[terms[k]])
        return np.array(out)

    def gains(self, named: Sequence[Term], offers: Sequence[Sequence[Term]]) -> Array:
        """Return (K,) by how much each of K sets of terms would raise the score [nats].

        Without regard to bounds. All of one size are computed at once.
        """
        terms = self.model(named)
        root, b, _, sd = self._solved(terms)
        xx, xr, _ = self.sums()
        z = solve_triangular(root, sd[:, None] * xx[self.at(terms)], lower=True)
        along = xr - solve_triangular(root, b, lower=True) @ z
        small = {t[:2]: self.sd(t) for t in terms if t.small}
        each = [self._offer(tuple(some)) for some in offers]
        sizes, out = np.array([len(x[0]) for x in each]), np.zeros(len(offers))
        for size in np.unique(sizes):
            which = np.flatnonzero(sizes == size)
            index = np.array([each[k][0] for k in which])
            variance = np.array([each[k][1] for k in which])
            for row, k in enumerate(which):
                some = offers[int(k)]
                if any(t[:2] in small for t in some):
                    variance[row] = np.concatenate(
                        [self._beside(t, small.get(t[:2])) for t in some]
                    )
            usual, zs = np.sqrt(variance), z[:, index]
            own = xx[index[:, :, None], index[:, None, :]] - np.einsum("pki,pkj->kij", zs, zs)
            unit = own * usual[:, :, None] * usual[:, None, :] + np.eye(size)
            moved = along[index] * usual
            value = np.einsum("ki,ki->k", moved, np.linalg.solve(unit, moved[..., None])[..., 0])
            out[which] = 0.5 * (value - np.linalg.slogdet(unit)[1])
        return out - np.array([x[2] for x in each])

    def _offer(self, some: tuple[Term, ...]) -> tuple[Index, Array, float]:
        """Return numbers and prior variances of some terms, and the odds against them."""
        if some not in self._offers:
            variance = np.concatenate([np.square(self.sd(t)) for t in some])
            odds = sum(self.odds[t] for t in some)
            self._offers[some] = self.at(some), variance, odds
        return self._offers[some]

    def _beside(self, term: Term, small: Array | None) -> Array:
        """Return (k,) prior variance that a term adds to the small error that it replaces."""
        whole = np.square(self.sd(term))
        if small is None or len(small) != len(whole):
            return whole
        return np.maximum(whole - np.square(small), DUPLICATE * whole)
