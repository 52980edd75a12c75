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
def add_rows(to: Array, at: Index, rows: Index, mixed: Array) -> None:
    """Add rows of ``mixed`` (F or more, P, r) to those ``at`` (k,) of ``to`` (F, p, r)."""
    for f in range(len(to)):
        for i in range(len(at)):
            one, other = to[f, at[i]], mixed[f, rows[i]]
            for k in range(len(one)):
                one[k] += other[k]


@compiled
def products(
    which: Index,
    shown_xx: Array,
    shown_xr: Array,
    at: Index,
    columns: Index,
    xx: Array,
    xr: Array,
    one: Array,
    two: Array,
) -> tuple[Array, Array, Array]:
    """Return c₁ᵀXᵀWX c₁, c₁ᵀXᵀWX c₂, and c₁ᵀXᵀWr of a joint, (B,) each.

    Args:
        which: (s,) random effects that the joint shows, as of `Shown`.
        shown_xx: (B, s, s), likewise.
        shown_xr: (B, s), likewise.
        at: (k,) coefficients of its other columns.
        columns: (k,) these.
        xx: (B, P, P) sums of all columns over each block.
        xr: (B, P) with the residual.
        one: (B, C) coefficients c₁, random effects first.
        two: (B, C) coefficients c₂.
    """
    blocks, s = shown_xr.shape
    out = np.zeros((3, blocks))
    force = np.empty(s)
    for b in range(blocks):
        own, other = one[b], two[b]
        force[:] = 0.0
        for i in range(s):
            row, c = shown_xx[b, i], own[which[i]]
            for k in range(s):
                force[k] += c * row[k]
        for i in range(len(at)):
            mixed, c = xx[b, columns[i]], own[at[i]]
            mine = 0.0
            for k in range(s):
                force[k] += c * mixed[which[k]]
                mine += mixed[which[k]] * own[which[k]]
            for k in range(len(at)):
                mine += mixed[columns[k]] * own[at[k]]
            out[0, b] += c * mine
            out[1, b] += other[at[i]] * mine
            out[2, b] += c * xr[b, columns[i]]
        for k in range(s):
            out[0, b] += own[which[k]] * force[k]
            out[1, b] += other[which[k]] * force[k]
            out[2, b] += own[which[k]] * shown_xr[b, k]
    return out[0], out[1], out[2]
