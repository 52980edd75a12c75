"""Least squares within bounds, many small systems at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
RIDGE = 1e-9
"""Ridge that keeps dependent columns solvable, over their squares [-]; assumed: far below any
effect."""
UNSEEN = 1e-12
"""Square of a column below which a system does not show it, over that in the others [-]; assumed:
rounding of a sum from which the only block that shows it was taken."""
PIVOT = 0.1 * RIDGE
"""Least pivot of a positive definite system [-]; assumed: with exact sums none is under the
ridge."""
SLOPE = 1e-12
"""Slope of the error, for columns of size one, with which a coefficient may stay on its bound [-];
assumed: rounding."""


def solve(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (P,) that minimise cᵀxx c − 2 cᵀxr within bounds."""
    return np.asarray(solve_all(xx[None], xr[None], low, high)[0])


def solve_all(xx: Array, xr: Array, low: Array, high: Array) -> Array:
    """Return the coefficients (B, P) of B systems (B, P, P) and (B, P), as of `solve`.

    Bounds are (P,), or (B, P) where systems have their own. The systems are of the same columns; a
    column that others show and one does not has no part in it.
    """
    normal, target, size = _with_columns_of_one(xx, xr)
    lows, highs = low * size, high * size
    out, solved = _by_active_sets(normal, target, lows, highs)
    for b in np.flatnonzero(~solved):
        out[b] = _general(normal[b], target[b], lows[b], highs[b])
    # a coefficient on a bound equals it exactly, since callers compare the two
    return np.where(out <= lows, low, np.where(out >= highs, high, out / size))


@compiled
def _with_columns_of_one(xx: Array, xr: Array) -> tuple[Array, Array, Array]:
    """Return the systems with columns of size one and a ridge, and (B, P) those sizes."""
    count, p = xr.shape
    normal, target, size = np.zeros((count, p, p)), np.zeros((count, p)), np.empty((count, p))
    seen = np.empty((count, p), dtype=np.bool_)
    for i in range(p):
        most = 0.0
        for b in range(count):
            most = max(most, xx[b, i, i])
        for b in range(count):
            seen[b, i] = xx[b, i, i] >= UNSEEN * most
            size[b, i] = np.sqrt(max(xx[b, i, i] if seen[b, i] else 0.0, 1e-300))
    for b in range(count):
        for i in range(p):
            normal[b, i, i] = RIDGE
            if not seen[b, i]:
                continue
            target[b, i] = xr[b, i] / size[b, i]
            for k in range(p):
                if seen[b, k]:
                    normal[b, i, k] += xx[b, i, k] / (size[b, i] * size[b, k])
    return normal, target, size


@compiled
def _by_active_sets(normal: Array, target: Array, low: Array, high: Array) -> tuple[Array, Flags]:
    """Return the minima (B, P) within bounds, and (B,) which were found.

    What leaves its bounds is held there, and the worst that would come back is let go. Systems
    whose active sets cycle, or that are not positive definite, are not solved.
    """
    count, p = target.shape
    out, solved = np.zeros((count, p)), np.zeros(count, dtype=np.bool_)
    for b in range(count):
        n, t, c, lowest, highest = normal[b], target[b], out[b], low[b], high[b]
        held = np.zeros(p, dtype=np.bool_)
        for _ in range(1 + 3 * p):
            if not _solve_others(n, t, held, c):
                break
            left = False
            for i in range(p):
                if c[i] < lowest[i] or c[i] > highest[i]:
                    c[i] = min(max(c[i], lowest[i]), highest[i])
                    held[i] = left = True
            if left:
                continue
            worst, at = SLOPE, -1
            for i in range(p):
                if held[i]:
                    slope = -t[i]
                    for k in range(p):
                        slope += n[i, k] * c[k]
                    inward = (c[i] <= lowest[i] and slope < 0) or (c[i] >= highest[i] and slope > 0)
                    if inward and abs(slope) > worst:
                        worst, at = abs(slope), i
            if at < 0:
                solved[b] = True
                break
            held[at] = False
    return out, solved


@compiled
def _solve_others(normal: Array, target: Array, held: Flags, c: Array) -> bool:
    """Solve a system for the coefficients that are not held, in place, by Cholesky's factors.

    Return whether it is positive definite: blocks that were taken off may leave rounding larger
    than the ridge.
    """
    some = np.flatnonzero(~held)
    m = len(some)
    a, y = np.empty((m, m)), np.empty(m)  # of a, the upper half
    for i in range(m):
        row, rest = normal[some[i]], target[some[i]]
        for k in range(len(held)):
            if held[k]:
                rest -= row[k] * c[k]
        y[i] = rest
        for k in range(i, m):
            a[i, k] = row[some[k]]
    for k in range(m):
        top = a[k]
        if top[k] < PIVOT:
            return False
        root = np.sqrt(top[k])
        for i in range(k, m):
            top[i] /= root
        y[k] /= root
        for i in range(k + 1, m):
            row, one = a[i], top[i]
            y[i] -= one * y[k]
            for j in range(i, m):
                row[j] -= one * top[j]
    for k in range(m - 1, -1, -1):
        rest = y[k]
        for j in range(k + 1, m):
            rest -= a[k, j] * y[j]
        y[k] = rest / a[k, k]
        c[some[k]] = y[k]
    return True


def _general(normal: Array, target: Array, low: Array, high: Array) -> Array:
    """Return the minimum (P,) within bounds by the method of Lawson and Hanson."""
    free = np.linalg.solve(normal, target)
    if np.all((free >= low) & (free <= high)):
        return np.asarray(free)
    size, axes = np.linalg.eigh(normal)
    root = np.sqrt(np.maximum(size, RIDGE))[:, None] * axes.T
    bounds = (np.minimum(low, high - 1e-12), high)
    return np.asarray(
        lsq_linear(root, np.linalg.solve(root.T, target), bounds=bounds, method="bvls").x
    )
