"""Least squares within bounds, many small systems at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]
RIDGE = 1e-9
"""Ridge that keeps dependent columns solvable, over their squares [-]; assumed: far below any
effect."""
UNSEEN = 1e-12
"""Square of a column below which a system does not show it, over that in the others [-]; assumed:
rounding of a sum from which the only block that shows it was taken."""


def solve(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (P,) that minimise cᵀxx c − 2 cᵀxr within bounds."""
    return np.asarray(solve_all(xx[None], xr[None], low, high)[0])


def solve_all(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (B, P) of B systems (B, P, P) and (B, P), as of `solve`.

    Bounds are (P,), or (B, P) where systems have their own. The systems are of the same columns; a
    column that others show and one does not has no part in it.
    """
    if not xr.shape[1]:
        return np.zeros_like(xr)
    square = np.diagonal(xx, axis1=1, axis2=2)
    unseen = square < UNSEEN * square.max(axis=0)
    if unseen.any():
        xx = np.where(unseen[:, :, None] | unseen[:, None, :], 0.0, xx)
        xr, square = np.where(unseen, 0.0, xr), np.where(unseen, 0.0, square)
    scale = np.sqrt(np.maximum(square, 1e-300))
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
