"""Least squares on sums over blocks: every fit, held-out error and resample from one pass.

Per joint the residual r (T,) and the columns X (T, P) of all causes are summed up once per block,
G_b = Xᵀ W X, g_b = Xᵀ W r, s_b = rᵀ W r. Any choice of columns, any set of blocks, any resample of
blocks is then a small linear system.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]
RIDGE = 1e-9
"""Relative ridge that keeps dependent columns solvable; far below any effect."""


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
    """(B,) samples of each block, by their weights."""

    @cached_property
    def whole(self) -> tuple[Array, Array, float]:
        """(P, P), (P,) and number: the sums over all blocks."""
        return self.xx.sum(axis=0), self.xr.sum(axis=0), float(self.rr.sum())

    @classmethod
    def of(
        cls, columns: Array, residual: Array, block: NDArray[np.int64], weight: Array, blocks: int
    ) -> Gram:
        """Sum up.

        Args:
            columns: (T, P).
            residual: (T,).
            block: (T,) block of each row, −1 for none.
            weight: (T,) of each row: robust weight over noise variance.
            blocks: number of blocks B.
        """
        p, x = columns.shape[1], columns.T
        xx, xr = np.zeros((blocks, p, p)), np.zeros((blocks, p))
        rr, count = np.zeros(blocks), np.zeros(blocks)
        for b, rows in _rows_of(block, blocks):
            root = np.sqrt(weight[rows])
            # a product with its own transpose, of which BLAS works out one half
            part, left = x[:, rows] * root, residual[rows] * root
            xx[b], xr[b], rr[b] = part @ part.T, part @ left, left @ left
            count[b] = weight[rows].sum()
        # in samples of full weight
        return cls(xx, xr, rr, count / max(float(weight.max(initial=0.0)), 1e-300))

    def with_columns(
        self,
        before: Array,
        more: Array,
        residual: Array,
        block: NDArray[np.int64],
        weight: Array,
    ) -> Gram:
        """Return the sums with further columns behind those that they have.

        Args:
            before: (T, P) columns that are summed up.
            more: (T, K) further ones.
            residual: (T,) as before, and so are the others.
            block: (T,).
            weight: (T,).
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


def _rows_of(
    block: NDArray[np.int64], blocks: int
) -> Iterator[tuple[int, slice | NDArray[np.int64]]]:
    """Yield each block that has rows with them, as a slice where they are neighbours."""
    for b in range(blocks):
        rows = np.flatnonzero(block == b)
        if len(rows):
            first, last = int(rows[0]), int(rows[-1])
            yield b, slice(first, last + 1) if last - first == len(rows) - 1 else rows


def solve(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (P,) that minimise cᵀxx c − 2 cᵀxr within bounds."""
    return np.asarray(solve_all(xx[None], xr[None], low, high)[0])


def solve_all(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (B, P) of B systems (B, P, P) and (B, P), as `solve` does."""
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
    # what is on a bound is on it to the last digit: whoever asks compares with the bound
    return np.where(out <= lows, low, np.where(out >= highs, high, out / scale))


def _bounded(normal: Array, target: Array, low: Array, high: Array, free: Array) -> Array:
    """Return the minima (B, P) within bounds by active sets, all systems at once.

    Lawson and Hanson's where they go round.
    """
    c = np.asarray(np.clip(free, low, high))
    held: NDArray[np.bool_] = np.asarray((free < low) | (free > high))
    left = np.arange(len(free))
    for _ in range(3 * free.shape[1]):
        n, x, fixed = normal[left], c[left], held[left]
        loose = np.logical_not(fixed)
        # what is held keeps its value, the others are solved for given it
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


class JointGrams:
    """The Grams of all joints."""

    def __init__(self, grams: Sequence[Gram]) -> None:
        self.joints = list(grams)
        self.blocks = len(grams[0].rr)
        # the same models come back again and again while causes are chosen
        self._fits: dict[ModelColumns, Array] = {}
        self._errors: dict[ModelColumns, Array] = {}
        self._left_out: dict[ModelColumns, Array] = {}
        self._held_out: dict[ModelColumns, Array] = {}

    def system(self, model: ModelColumns, weight: Array | None = None) -> tuple[Array, Array]:
        """Return (xx, xr) of a model over blocks with multiplicities ``weight`` (B,), or all."""
        p = len(model.low)
        xx, xr = np.zeros((p, p)), np.zeros(p)
        for gram, columns, where in zip(
            self.joints, model.columns, model.coefficients, strict=True
        ):
            if not columns:
                continue
            cols, at = np.array(columns), np.array(where)
            if weight is None:
                part, along = gram.whole[0][cols[:, None], cols], gram.whole[1][cols]
            else:
                part = np.einsum("b,bpq->pq", weight, gram.xx[:, cols[:, None], cols])
                along = np.einsum("b,bp->p", weight, gram.xr[:, cols])
            # each coefficient has one column of a joint at most
            xx[at[:, None], at] += part
            xr[at] += along
        xx[np.diag_indices(p)] += model.prior
        return xx, xr

    def fit(self, model: ModelColumns, weight: Array | None = None) -> Array:
        """Return the coefficients of a model, fitted to blocks with multiplicities ``weight``."""
        if weight is None and model in self._fits:
            return self._fits[model]
        xx, xr = self.system(model, weight)
        out = solve(xx, xr, np.array(model.low), np.array(model.high))
        if weight is None:
            self._fits[model] = out
        return out

    def errors(self, model: ModelColumns) -> Array:
        """Return (joints,) squared errors that the fit leaves, in units of noise variance."""
        if model in self._errors:
            return self._errors[model]
        c, out = self.fit(model), np.empty(len(self.joints))
        for j, (gram, columns, where) in enumerate(
            zip(self.joints, model.columns, model.coefficients, strict=True)
        ):
            cols, mine = np.array(columns, dtype=int), c[np.array(where, dtype=int)]
            xx, xr, rr = gram.whole
            out[j] = rr - 2 * xr[cols] @ mine + mine @ xx[cols[:, None], cols] @ mine
        self._errors[model] = np.maximum(out, 0.0)
        return self._errors[model]

    def block_systems(self, model: ModelColumns) -> tuple[Array, Array]:
        """Return xx (B, P, P) and xr (B, P) of a model in each block, without its prior."""
        p = len(model.low)
        xx, xr = np.zeros((self.blocks, p, p)), np.zeros((self.blocks, p))
        for gram, columns, where in zip(
            self.joints, model.columns, model.coefficients, strict=True
        ):
            if columns:
                cols, at = np.array(columns), np.array(where)
                xx[:, at[:, None], at] += gram.xx[:, cols[:, None], cols]
                xr[:, at] += gram.xr[:, cols]
        return xx, xr

    def leave_one_block_out(self, model: ModelColumns) -> Array:
        """Return (B, P) the fit to all blocks but each."""
        if model in self._left_out:
            return self._left_out[model]
        xx, xr = self.block_systems(model)
        low, high = np.array(model.low), np.array(model.high)
        prior = np.diag(model.prior)
        out = solve_all(xx.sum(axis=0) - xx + prior, xr.sum(axis=0) - xr, low, high)
        self._left_out[model] = out
        return out

    def held_out(self, model: ModelColumns) -> Array:
        """Return (joints, B) squared errors of each block under the fit of all others."""
        if model in self._held_out:
            return self._held_out[model]
        c = self.leave_one_block_out(model)
        out = np.empty((len(self.joints), self.blocks))
        for j, (gram, columns, where) in enumerate(
            zip(self.joints, model.columns, model.coefficients, strict=True)
        ):
            cols, mine = np.array(columns, dtype=int), c[:, np.array(where, dtype=int)]
            xx, xr = gram.xx[:, cols[:, None], cols], gram.xr[:, cols]
            out[j] = gram.rr - 2 * (xr * mine).sum(axis=1)
            out[j] += (np.einsum("bpq,bp->bq", xx, mine) * mine).sum(axis=1)
        self._held_out[model] = np.maximum(out, 0.0)
        return self._held_out[model]

    def cross_predicted(
        self, model: ModelColumns, rest: ModelColumns, own: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Return pᵀe and pᵀp (joints, B) of what a model predicts beyond a smaller one.

        Both are fitted to all blocks but the one they predict; p is the difference of their
        torques there, e is what the smaller one leaves. Where what is more is real, pᵀe = pᵀp but
        for noise; where it is not, pᵀe is about zero.

        Args:
            model: model.
            rest: the smaller one.
            own: (P,) the coefficients that are in the former only.
        """
        before = np.zeros((self.blocks, len(own)))
        before[:, ~own] = self.leave_one_block_out(rest)
        more = self.leave_one_block_out(model) - before
        pe, pp = np.zeros((2, len(self.joints), self.blocks))
        for j, (gram, columns, where) in enumerate(
            zip(self.joints, model.columns, model.coefficients, strict=True)
        ):
            if not columns:
                continue
            cols, at = np.array(columns), np.array(where)
            a, c = more[:, at], before[:, at]
            force = np.einsum("bpq,bp->bq", gram.xx[:, cols[:, None], cols], a)
            pp[j] = (force * a).sum(axis=1)
            pe[j] = (gram.xr[:, cols] * a).sum(axis=1) - (force * c).sum(axis=1)
        return pe, pp

    def gained(self, model: ModelColumns, rest: ModelColumns) -> Array:
        """Return (joints,) torque of a model that a smaller one has not, over the noise.

        Root mean square, by what the fit to all blocks gains.
        """
        less = self.errors(rest) - self.errors(model)
        count = np.array([max(g.count.sum(), 1.0) for g in self.joints])
        return np.asarray(np.sqrt(np.maximum(less, 0.0) / count))

    def sizes(self, model: ModelColumns, own: NDArray[np.bool_]) -> Array:
        """Return (joints,) root mean square torque of some coefficients over the noise."""
        c = self.fit(model) * own
        out = np.zeros(len(self.joints))
        for j, (gram, columns, where) in enumerate(
            zip(self.joints, model.columns, model.coefficients, strict=True)
        ):
            cols, at = np.array(columns, dtype=int), np.array(where, dtype=int)
            xx = gram.whole[0][cols[:, None], cols] / max(gram.count.sum(), 1.0)
            out[j] = np.sqrt(max(c[at] @ xx @ c[at], 0.0))
        return out

    def resample(
        self, model: ModelColumns, times: int, rng: np.random.Generator, spread: Array | None = None
    ) -> Array:
        """Return (times, P) coefficients of bootstrap resamples of the blocks.

        Args:
            model: model.
            times: resamples.
            rng: draws them.
            spread: (P,) standard deviations of the prior, whose mean is drawn too: what the blocks
                do not show is then as uncertain as it was before; None for no prior.
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
