"""Least squares on sums over blocks: every fit, held-out error and resample from one pass.

Per joint the residual r (T,) and the columns X (T, P) of all causes are summed once per block,
G_b = Xᵀ W X, g_b = Xᵀ W r, s_b = rᵀ W r. Any choice of columns, any set of blocks, any resample of
blocks is then a small linear system.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Method = TypeVar("Method", bound=Callable[..., Array])
RIDGE = 1e-9
"""Ridge that keeps dependent columns solvable, over their squares [-]; assumed: far below any
effect."""


@dataclass(frozen=True, eq=False)
class Gram:
    """Sums of one joint, in units of its noise."""

    xx: Array
    """(B, P, P)."""
    xr: Array
    """(B, P)."""
    rr: Array
    """(B,)."""
    count: Array
    """(B,) number of rows of each block, by their weights."""

    @cached_property
    def whole(self) -> tuple[Array, Array, float]:
        """The sums over all blocks: (P, P), (P,) and a number."""
        return self.xx.sum(axis=0), self.xr.sum(axis=0), float(self.rr.sum())

    @classmethod
    def of(cls, columns: Array, residual: Array, block: Index, weight: Array, blocks: int) -> Gram:
        """Compute the sums.

        Args:
            columns: (T, P) columns.
            residual: (T,) residual.
            block: (T,) block of each row, −1 for none.
            weight: (T,) robust weight of each row over the noise variance.
            blocks: number of blocks B.
        """
        p, x = columns.shape[1], columns.T
        xx, xr = np.zeros((blocks, p, p)), np.zeros((blocks, p))
        rr, count = np.zeros(blocks), np.zeros(blocks)
        for b, rows in _rows_of(block, blocks):
            root = np.sqrt(weight[rows])
            # BLAS computes half of a product with its own transpose
            part, left = x[:, rows] * root, residual[rows] * root
            xx[b], xr[b], rr[b] = part @ part.T, part @ left, left @ left
            count[b] = weight[rows].sum()
        # in rows of full weight
        return cls(xx, xr, rr, count / max(float(weight.max(initial=0.0)), 1e-300))

    def with_columns(
        self, before: Array, more: Array, residual: Array, block: Index, weight: Array
    ) -> Gram:
        """Return the sums with further columns after the present ones.

        Args:
            before: (T, P) present columns.
            more: (T, K) further columns.
            residual: (T,) residual, as of `of`.
            block: (T,) blocks, as of `of`.
            weight: (T,) weights, as of `of`.
        """
        old, new = before.shape[1], more.shape[1]
        xx = np.zeros((len(self.rr), old + new, old + new))
        xr = np.zeros((len(self.rr), old + new))
        xx[:, :old, :old], xr[:, :old] = self.xx, self.xr
        for b, rows in _rows_of(block, len(self.rr)):
            part = more.T[:, rows] * weight[rows]
            xx[b, old:, :old], xr[b, old:] = part @ before[rows], part @ residual[rows]
            own = part @ more[rows]
            xx[b, old:, old:] = (own + own.T) / 2
        xx[:, :old, old:] = np.swapaxes(xx[:, old:, :old], 1, 2)
        return Gram(xx, xr, self.rr, self.count)


def _rows_of(block: Index, blocks: int) -> Iterator[tuple[int, slice | Index]]:
    """Yield each block that has rows, and its rows, as a slice where they are neighbours."""
    for b in range(blocks):
        rows = np.flatnonzero(block == b)
        if len(rows):
            first, last = int(rows[0]), int(rows[-1])
            yield b, slice(first, last + 1) if last - first == len(rows) - 1 else rows


def solve(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (P,) that minimise cᵀxx c − 2 cᵀxr within bounds."""
    return np.asarray(solve_all(xx[None], xr[None], low, high)[0])


def solve_all(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (B, P) of B systems (B, P, P) and (B, P), as of `solve`."""
    if not xr.shape[1]:
        return np.zeros_like(xr)
    scale = np.sqrt(np.maximum(np.diagonal(xx, axis1=1, axis2=2), 1e-300))
    normal = xx / (scale[:, :, None] * scale[:, None, :]) + RIDGE * np.eye(xr.shape[1])
    target = xr / scale
    out = np.linalg.solve(normal, target[..., None])[..., 0]
    lows, highs = low * scale, high * scale
    beyond = ((out < lows) | (out > highs)).any(axis=1)
    if beyond.any():
        some = (x[beyond] for x in (normal, target, lows, highs, out))
        out[beyond] = _bounded(*some)
    # a coefficient on a bound equals it exactly, since callers compare the two
    return np.where(out <= lows, low, np.where(out >= highs, high, out / scale))


def _bounded(normal: Array, target: Array, low: Array, high: Array, free: Array) -> Array:
    """Return the minima (B, P) within bounds by active sets, all systems at once.

    The method of Lawson and Hanson solves the systems whose active sets cycle.
    """
    c = np.asarray(np.clip(free, low, high))
    held: NDArray[np.bool_] = np.asarray((free < low) | (free > high))
    left = np.arange(len(free))
    for _ in range(3 * free.shape[1]):
        n, x, fixed = normal[left], c[left], held[left]
        loose = np.logical_not(fixed)
        # held coefficients keep their values; the others are solved given them
        rest = target[left] - np.einsum("bpq,bq->bp", n, np.where(fixed, x, 0.0))
        system = np.where(loose[:, :, None] & loose[:, None, :], n, 0.0)
        system += fixed[:, :, None] * np.eye(x.shape[1])
        x = np.linalg.solve(system, np.where(loose, rest, x)[..., None])[..., 0]
        x[fixed] = c[left][fixed]
        out: NDArray[np.bool_] = np.asarray(loose & ((x < low[left]) | (x > high[left])))
        x = np.where(out, np.clip(x, low[left], high[left]), x)
        slope = np.einsum("bpq,bq->bp", n, x) - target[left]
        inward = ((x <= low[left]) & (slope < -1e-12)) | ((x >= high[left]) & (slope > 1e-12))
        done = np.asarray(out.any(axis=1))
        inward &= fixed & np.logical_not(done)[:, None]
        back = np.flatnonzero(inward.any(axis=1))
        fixed |= out
        fixed[back, np.argmax(np.where(inward, np.abs(slope), -1.0), axis=1)[back]] = False
        c[left], held[left] = x, fixed
        left = left[done | inward.any(axis=1)]
        if not len(left):
            return c
    for b in left:
        # blocks that were taken off may leave rounding larger than the ridge
        size, axes = np.linalg.eigh(normal[b])
        root = np.sqrt(np.maximum(size, RIDGE))[:, None] * axes.T
        bounds = (np.minimum(low[b], high[b] - 1e-12), high[b])
        right = np.linalg.solve(root.T, target[b])
        c[b] = lsq_linear(root, right, bounds=bounds, method="bvls").x
    return c


@dataclass(frozen=True)
class ModelColumns:
    """Columns of a model: for each joint which of its columns, and which coefficient each has.

    A coefficient that several joints share (payload, tilt, delay) appears in several.
    """

    columns: tuple[tuple[int, ...], ...]
    coefficients: tuple[tuple[int, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    firm: tuple[float, ...] = ()
    """Prior precision of each coefficient about zero, in the sums' units; () for none."""

    @property
    def prior(self) -> Array:
        """(P,) that precision."""
        return np.array(self.firm) if self.firm else np.zeros(len(self.low))


def _kept(method: Method) -> Method:
    """Keep the result of a method of `JointGrams` for each model: the search repeats models."""

    @wraps(method)
    def kept(self: JointGrams, model: ModelColumns, weight: Array | None = None) -> Any:
        if weight is not None:
            return method(self, model, weight)
        key = method.__name__, model
        if key not in self._results:
            self._results[key] = method(self, model)
        return self._results[key]

    return cast(Method, kept)


class JointGrams:
    """The Grams of all joints."""

    def __init__(self, grams: Sequence[Gram]) -> None:
        self.joints = list(grams)
        self.blocks = len(grams[0].rr)
        self.counts = np.array([g.count.sum() for g in grams])
        """(joints,) number of rows, by their weights."""
        self._results: dict[tuple[str, ModelColumns], Array] = {}

    def _each(self, model: ModelColumns) -> Iterator[tuple[int, Gram, Index, Index]]:
        """Yield the joints with columns: number, sums, columns, and their coefficients."""
        for j, (columns, where) in enumerate(zip(model.columns, model.coefficients, strict=True)):
            if columns:
                yield j, self.joints[j], np.array(columns), np.array(where)

    def system(self, model: ModelColumns, weight: Array | None = None) -> tuple[Array, Array]:
        """Return (xx, xr) of a model, over blocks with multiplicities ``weight`` (B,) or 1."""
        p = len(model.low)
        xx, xr = np.zeros((p, p)), np.zeros(p)
        for _, gram, cols, at in self._each(model):
            if weight is None:
                part, along = gram.whole[0][cols[:, None], cols], gram.whole[1][cols]
            else:
                part = np.einsum("b,bpq->pq", weight, gram.xx[:, cols[:, None], cols])
                along = np.einsum("b,bp->p", weight, gram.xr[:, cols])
            # each coefficient has at most one column of a joint
            xx[at[:, None], at] += part
            xr[at] += along
        xx[np.diag_indices(p)] += model.prior
        return xx, xr

    @_kept
    def fit(self, model: ModelColumns, weight: Array | None = None) -> Array:
        """Return the coefficients of a model, fitted to blocks with multiplicities ``weight``."""
        xx, xr = self.system(model, weight)
        return solve(xx, xr, np.array(model.low), np.array(model.high))

    @_kept
    def errors(self, model: ModelColumns) -> Array:
        """Return (joints,) squared errors that the fit leaves, in units of noise variance."""
        c, out = self.fit(model), np.array([g.whole[2] for g in self.joints])
        for j, gram, cols, at in self._each(model):
            mine, (xx, xr, rr) = c[at], gram.whole
            out[j] = rr - 2 * xr[cols] @ mine + mine @ xx[cols[:, None], cols] @ mine
        return np.maximum(out, 0.0)

    def block_systems(self, model: ModelColumns) -> tuple[Array, Array]:
        """Return xx (B, P, P) and xr (B, P) of a model in each block, without its prior."""
        p = len(model.low)
        xx, xr = np.zeros((self.blocks, p, p)), np.zeros((self.blocks, p))
        for _, gram, cols, at in self._each(model):
            xx[:, at[:, None], at] += gram.xx[:, cols[:, None], cols]
            xr[:, at] += gram.xr[:, cols]
        return xx, xr

    @_kept
    def leave_one_block_out(self, model: ModelColumns) -> Array:
        """Return (B, P) the fit to all blocks but each."""
        xx, xr = self.block_systems(model)
        low, high = np.array(model.low), np.array(model.high)
        prior = np.diag(model.prior)
        return solve_all(xx.sum(axis=0) - xx + prior, xr.sum(axis=0) - xr, low, high)

    @_kept
    def held_out(self, model: ModelColumns) -> Array:
        """Return (joints, B) squared errors of each block under the fit of all others."""
        c = self.leave_one_block_out(model)
        out = np.array([g.rr for g in self.joints])
        for j, gram, cols, at in self._each(model):
            mine, xx, xr = c[:, at], gram.xx[:, cols[:, None], cols], gram.xr[:, cols]
            out[j] -= 2 * (xr * mine).sum(axis=1)
            out[j] += (np.einsum("bpq,bp->bq", xx, mine) * mine).sum(axis=1)
        return np.maximum(out, 0.0)

    def cross_predicted(
        self, model: ModelColumns, rest: ModelColumns, own: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Return pᵀe and pᵀp (joints, B) of what a model predicts beyond a smaller one.

        Both are fitted to all blocks but the one they predict; p is the difference of their
        torques there, e is the error of the smaller one. Where the difference is real, pᵀe = pᵀp
        except for noise; where it is not, pᵀe is about zero.

        Args:
            model: the model.
            rest: the smaller model.
            own: (P,) which coefficients only the former has.
        """
        before = np.zeros((self.blocks, len(own)))
        before[:, ~own] = self.leave_one_block_out(rest)
        more = self.leave_one_block_out(model) - before
        pe, pp = np.zeros((2, len(self.joints), self.blocks))
        for j, gram, cols, at in self._each(model):
            a, c = more[:, at], before[:, at]
            force = np.einsum("bpq,bp->bq", gram.xx[:, cols[:, None], cols], a)
            pp[j] = (force * a).sum(axis=1)
            pe[j] = (gram.xr[:, cols] * a).sum(axis=1) - (force * c).sum(axis=1)
        return pe, pp

    def gained(self, model: ModelColumns, rest: ModelColumns) -> Array:
        """Return (joints,) torque of a model that a smaller one lacks, over the noise.

        Root mean square, from the gain of the fit to all blocks.
        """
        less = self.errors(rest) - self.errors(model)
        return np.asarray(np.sqrt(np.maximum(less, 0.0) / np.maximum(self.counts, 1.0)))

    def sizes(self, model: ModelColumns, own: NDArray[np.bool_]) -> Array:
        """Return (joints,) root mean square torque of some coefficients over the noise."""
        c = self.fit(model) * own
        out = np.zeros(len(self.joints))
        for j, gram, cols, at in self._each(model):
            xx = gram.whole[0][cols[:, None], cols] / max(self.counts[j], 1.0)
            out[j] = np.sqrt(max(c[at] @ xx @ c[at], 0.0))
        return out

    def resample(
        self, model: ModelColumns, times: int, rng: np.random.Generator, spread: Array | None = None
    ) -> Array:
        """Return (times, P) coefficients of bootstrap resamples of the blocks.

        Args:
            model: the model.
            times: number of resamples.
            rng: random generator.
            spread: (P,) standard deviations of the prior, whose mean is drawn too, so that what the
                blocks do not show stays as uncertain; None for no prior.
        """
        draws = rng.multinomial(self.blocks, np.full(self.blocks, 1 / self.blocks), size=times)
        systems = [self.system(model, w) for w in draws.astype(float)]
        xx, xr = (np.array(x) for x in zip(*systems, strict=True))
        if spread is not None and model.prior.any():
            own = np.where(model.prior > 0, spread, 0.0)
            xr = xr + model.prior * own * rng.normal(size=xr.shape)
        return solve_all(xx, xr, np.array(model.low), np.array(model.high))


def share_found(pe: Array, pp: Array) -> tuple[Array, Array]:
    """Return (n,) the part of a predicted torque that is found, and its standard error [-].

    Args:
        pe: (B, n) sums over blocks of predicted torque times what is left without it.
        pp: (B, n) of predicted torque squared.

    Returns:
        Σpe/Σpp, and √(Σ(pe − a pp)²·B/(B − 1))/Σpp between blocks (K.-Y. Liang, S. Zeger,
        "Longitudinal data analysis using generalized linear models", Biometrika 1986); NaN
        without a torque, an infinite error with a single block.
    """
    total = pp.sum(axis=0)
    some = np.where(total > 0, total, np.nan)
    a = pe.sum(axis=0) / some
    if len(pp) < 2:
        return a, np.where(np.isnan(a), np.nan, np.inf)
    spread = np.sqrt(np.square(pe - a * pp).sum(axis=0) * len(pp) / (len(pp) - 1))
    return a, spread / some


def t_statistic(pe: Array, pp: Array) -> float:
    """Return `share_found` over its standard error, of sums over blocks (B,)."""
    if float(pp.sum()) <= 0 or len(pp) < 2:
        return 0.0
    a, error = (float(x[0]) for x in share_found(pe[:, None], pp[:, None]))
    return a / max(error, 1e-12)
