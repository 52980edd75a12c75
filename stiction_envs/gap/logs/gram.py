"""Least squares on sums over blocks: every fit, held-out error and resample from one pass.

Per joint the residual r (T,) and the columns X (T, P) of all causes are summed up once per block,
G_b = Xᵀ W X, g_b = Xᵀ W r, s_b = rᵀ W r. Any choice of columns, any set of blocks, any resample of
blocks is then a small linear system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """(B,) weight of each block in samples."""

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
        p = columns.shape[1]
        xx, xr = np.zeros((blocks, p, p)), np.zeros((blocks, p))
        rr, count = np.zeros(blocks), np.zeros(blocks)
        for b in range(blocks):
            rows = block == b
            x, r, w = columns[rows], residual[rows], weight[rows]
            weighted = x * w[:, None]
            xx[b], xr[b] = weighted.T @ x, weighted.T @ r
            rr[b], count[b] = float((w * r * r).sum()), float(rows.sum())
        return cls(xx, xr, rr, count)


def solve(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (P,) that minimise cᵀxx c − 2 cᵀxr within bounds."""
    if not len(xr):
        return np.zeros(0)
    scale = np.sqrt(np.maximum(np.diag(xx), 1e-300))
    normal = xx / np.outer(scale, scale) + RIDGE * np.eye(len(xr))
    target = xr / scale
    free = np.linalg.solve(normal, target) / scale
    if np.all((free >= low) & (free <= high)):
        return np.asarray(free)
    root = np.linalg.cholesky(normal).T
    right = np.linalg.solve(root.T, target)
    bounds = (np.minimum(low * scale, high * scale - 1e-12), high * scale)
    return np.asarray(lsq_linear(root, right, bounds=bounds, method="bvls").x / scale)


def error(xx: Array, xr: Array, rr: Array, c: Array) -> Array:
    """Return the squared error of coefficients on summed blocks, one number per leading index."""
    return np.asarray(
        rr - 2 * np.einsum("...p,p->...", xr, c) + np.einsum("...pq,p,q->...", xx, c, c)
    )


@dataclass(frozen=True)
class Pick:
    """Columns of a model: for each joint which of its columns, and which coefficient each has.

    A coefficient that several joints share (payload, tilt, delay) appears in several.
    """

    columns: tuple[tuple[int, ...], ...]
    coefficients: tuple[tuple[int, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


class Stack:
    """The Grams of all joints."""

    def __init__(self, grams: Sequence[Gram]) -> None:
        self.grams = list(grams)
        self.blocks = len(grams[0].rr)

    def system(self, pick: Pick, weight: Array) -> tuple[Array, Array]:
        """Return (xx, xr) of a model over blocks with multiplicities ``weight`` (B,)."""
        p = len(pick.low)
        xx, xr = np.zeros((p, p)), np.zeros(p)
        for gram, columns, where in zip(self.grams, pick.columns, pick.coefficients, strict=True):
            if not columns:
                continue
            cols, at = np.array(columns), np.array(where)
            part = np.einsum("b,bpq->pq", weight, gram.xx[:, cols[:, None], cols])
            np.add.at(xx, (at[:, None], at), part)
            np.add.at(xr, at, np.einsum("b,bp->p", weight, gram.xr[:, cols]))
        return xx, xr

    def fit(self, pick: Pick, weight: Array | None = None) -> Array:
        """Return the coefficients of a model, fitted to blocks with multiplicities ``weight``."""
        weight = np.ones(self.blocks) if weight is None else weight
        xx, xr = self.system(pick, weight)
        return solve(xx, xr, np.array(pick.low), np.array(pick.high))

    def errors(self, pick: Pick, c: Array) -> Array:
        """Return (joints, B) squared errors of coefficients, in units of noise variance."""
        out = np.empty((len(self.grams), self.blocks))
        for j, (gram, columns, where) in enumerate(
            zip(self.grams, pick.columns, pick.coefficients, strict=True)
        ):
            cols = np.array(columns, dtype=int)
            mine = c[np.array(where, dtype=int)]
            out[j] = error(gram.xx[:, cols[:, None], cols], gram.xr[:, cols], gram.rr, mine)
        return np.maximum(out, 0.0)

    def held_out(self, pick: Pick) -> Array:
        """Return (joints, B) squared errors of each block under the fit of all others."""
        p = len(pick.low)
        xx, xr = np.zeros((self.blocks, p, p)), np.zeros((self.blocks, p))
        used = []
        for gram, columns, where in zip(self.grams, pick.columns, pick.coefficients, strict=True):
            cols, at = np.array(columns, dtype=int), np.array(where, dtype=int)
            part_xx, part_xr = gram.xx[:, cols[:, None], cols], gram.xr[:, cols]
            used.append((part_xx, part_xr, at))
            if len(cols):
                xx[:, at[:, None], at] += part_xx
                xr[:, at] += part_xr
        out = np.empty((len(self.grams), self.blocks))
        low, high = np.array(pick.low), np.array(pick.high)
        for b in range(self.blocks):
            c = solve(xx.sum(axis=0) - xx[b], xr.sum(axis=0) - xr[b], low, high)
            for j, (part_xx, part_xr, at) in enumerate(used):
                out[j, b] = error(part_xx[b], part_xr[b], self.grams[j].rr[b], c[at])
        return np.maximum(out, 0.0)

    def resample(self, pick: Pick, times: int, rng: np.random.Generator) -> Array:
        """Return (times, P) coefficients of bootstrap resamples of the blocks."""
        draws = rng.multinomial(self.blocks, np.full(self.blocks, 1 / self.blocks), size=times)
        return np.array([self.fit(pick, w.astype(float)) for w in draws])
