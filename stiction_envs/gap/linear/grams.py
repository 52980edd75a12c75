"""Sums over blocks: every fit, held-out error and resample from one pass over the logs.

Per joint the residual r (T,) and the columns X (T, P) of all causes are summed once per block,
G_b = Xᵀ W X, g_b = Xᵀ W r, s_b = rᵀ W r. Any choice of columns, any set of blocks, any resample of
blocks is then a small linear system.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Parts = Sequence[NDArray[np.floating]]
Index = NDArray[np.int64]


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
    def whole(self) -> Gram:
        """The sums over all blocks, as of one."""
        return Gram(
            *(x.sum(axis=0, keepdims=True) for x in (self.xx, self.xr, self.rr, self.count))
        )

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
        return cls.of_parts([columns.T], residual, block, weight, blocks)

    @classmethod
    def of_parts(
        cls, parts: Parts, residual: Array, block: Index, weight: Array, blocks: int
    ) -> Gram:
        """Compute the sums of columns in parts, (k, T) each, side by side; otherwise `of`."""
        p = sum(len(x) for x in parts)
        xx, xr = np.zeros((blocks, p, p)), np.zeros((blocks, p))
        rr, count = np.zeros(blocks), np.zeros(blocks)
        for b, rows in _rows_of(block, blocks):
            root = np.sqrt(weight[rows])
            own, left = _side_by_side(parts, rows), residual[rows] * root
            own *= root
            # BLAS computes half of a product with its own transpose
            xx[b], xr[b], rr[b] = own @ own.T, own @ left, left @ left
            count[b] = weight[rows].sum()
        # in rows of full weight
        return cls(xx, xr, rr, count / max(float(weight.max(initial=0.0)), 1e-300))

    def with_columns(
        self,
        before: Parts,
        more: Parts,
        residual: Array,
        block: Index,
        weight: Array,
    ) -> Gram:
        """Return the sums with further columns after the present ones.

        Args:
            before: present columns, in parts (k, T).
            more: further columns, in parts (k, T).
            residual: (T,) residual, as of `of`.
            block: (T,) blocks, as of `of`.
            weight: (T,) weights, as of `of`.
        """
        old, new = (sum(len(x) for x in parts) for parts in (before, more))
        xx = np.zeros((len(self.rr), old + new, old + new))
        xr = np.zeros((len(self.rr), old + new))
        xx[:, :old, :old], xr[:, :old] = self.xx, self.xr
        for b, rows in _rows_of(block, len(self.rr)):
            own = _side_by_side(more, rows)
            part = own * weight[rows]
            xx[b, old:, :old] = part @ _side_by_side(before, rows).T
            xr[b, old:] = part @ residual[rows]
            square = part @ own.T
            xx[b, old:, old:] = (square + square.T) / 2
        xx[:, :old, old:] = np.swapaxes(xx[:, old:, :old], 1, 2)
        return Gram(xx, xr, self.rr, self.count)


def _side_by_side(parts: Parts, rows: slice | Index) -> Array:
    """Return (P, R) some rows of columns in parts (k, T), as a copy."""
    return np.concatenate([x[:, rows] for x in parts], dtype=np.float64)


def _rows_of(block: Index, blocks: int) -> Iterator[tuple[int, slice | Index]]:
    """Yield each block that has rows, and its rows, as a slice where they are neighbours."""
    for b in range(blocks):
        rows = np.flatnonzero(block == b)
        if len(rows):
            first, last = int(rows[0]), int(rows[-1])
            yield b, slice(first, last + 1) if last - first == len(rows) - 1 else rows


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


def t_statistic(pe: Array, pp: Array) -> Array:
    """Return `share_found` over its standard error, of sums over blocks (B, ...).

    It is zero without a torque, or without a second block.
    """
    if len(pp) < 2:
        return np.zeros(pp.shape[1:])
    a, error = share_found(pe, pp)
    return np.asarray(np.where(np.isnan(a), 0.0, a / np.maximum(error, 1e-12)))
