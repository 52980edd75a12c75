"""A model's equations and errors from the sums of its columns on a joint, compiled.

A search asks thousands of models of a few dozen columns each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Shown(NamedTuple):
    """Sums of the s random effects that a joint shows, over B blocks, side by side in memory."""

    which: Index
    """(s,) of all random effects."""
    xx: Array
    """(B, s, s)."""
    xr: Array
    """(B, s) with the residual."""


@compiled
def add_equations(
    to_xx: Array, to_xr: Array, at: Index, columns: Index, xx: Array, xr: Array, rows: float
) -> None:
    """Add a joint to normal equations (F, p, p) and (F, p): of all blocks, and without each.

    Args:
        to_xx: changed; F is 1, or 1 + B.
        to_xr: changed.
        at: (k,) coefficients of some columns.
        columns: (k,) these.
        xx: (B, P, P) sums of all columns over each block.
        xr: (B, P) with the residual.
        rows: that form one independent observation.
    """
    blocks, fits = len(xx), len(to_xx)
    for i in range(len(at)):
        row, one = columns[i], at[i]
        whole = 0.0
        for b in range(blocks):
            whole += xr[b, row]
        for f in range(fits):
            to_xr[f, one] += (whole - (xr[f - 1, row] if f > 0 else 0.0)) / rows
        for k in range(i + 1):
            column, other = columns[k], at[k]
            whole = 0.0
            for b in range(blocks):
                whole += xx[b, row, column]
            for f in range(fits):
                part = (whole - (xx[f - 1, row, column] if f > 0 else 0.0)) / rows
                to_xx[f, one, other] += part
                if k < i:
                    to_xx[f, other, one] += part


@compiled
def products(
    shown: Shown, at: Index, columns: Index, xx: Array, xr: Array, one: Array, two: Array
) -> tuple[Array, Array]:
    """Return c₁ᵀXᵀWX c₂ and c₁ᵀXᵀWr (B,) of a joint.

    Args:
        shown: the random effects that it shows, which come first in ``one`` and ``two``.
        at: (k,) coefficients of its other columns.
        columns: (k,) these.
        xx: (B, P, P) sums of all columns over each block.
        xr: (B, P) with the residual.
        one: (B, C) coefficients c₁.
        two: (B, C) coefficients c₂.
    """
    blocks, s = shown.xr.shape
    square, along = np.zeros(blocks), np.zeros(blocks)
    force, mine = np.empty(s), np.empty(s)
    for b in range(blocks):
        for k in range(s):
            force[k], mine[k] = 0.0, two[b, shown.which[k]]
        for i in range(s):
            row, c = shown.xx[b, i], one[b, shown.which[i]]
            along[b] += c * shown.xr[b, i]
            for k in range(s):
                force[k] += c * row[k]
        for i in range(len(at)):
            mixed, c, c_two = xx[b, columns[i]], one[b, at[i]], two[b, at[i]]
            along[b] += c * xr[b, columns[i]]
            for k in range(s):
                shared = mixed[shown.which[k]]
                force[k] += c * shared
                square[b] += c_two * one[b, shown.which[k]] * shared
            for k in range(len(at)):
                square[b] += c * mixed[columns[k]] * two[b, at[k]]
        for k in range(s):
            square[b] += force[k] * mine[k]
    return square, along
