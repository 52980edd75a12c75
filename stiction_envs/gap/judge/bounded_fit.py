"""Least squares within bounds."""

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.optimize import lsq_linear

from stiction_envs.arrays import Array

SLOPE = 1e-9
"""Slope of the error, over the largest target, with which a coefficient may stay on its bound [-];
assumed: rounding."""


def solve(a: Array, b: Array, low: Array, high: Array, free: Array) -> Array:
    """Return the coefficients c (P,) within bounds that minimise cᵀ a c − 2 cᵀ b.

    What leaves its bounds is held there, and what would come back most is let go, one at a time;
    where that goes round in circles, by the method of Lawson and Hanson. A coefficient on a bound
    equals the bound exactly.

    Args:
        a: (P, P), positive definite.
        b: (P,).
        low, high: (P,) bounds.
        free: (P,) the coefficients without bounds.
    """
    held, c = (free < low) | (free > high), np.clip(free, low, high)
    least = SLOPE * float(np.abs(b).max(initial=0.0))
    for _ in range(3 * len(b) + 1):
        rest = ~held
        target = b[rest] - a[np.ix_(rest, held)] @ c[held]
        if rest.any():
            _, c[rest], _ = dposv(a[np.ix_(rest, rest)], target)
        left = (c < low) | (c > high)
        if left.any():
            held |= left
            c = np.clip(c, low, high)
            continue
        slope = a @ c - b
        back = held & np.where(c <= low, slope < -least, slope > least)
        if not back.any():
            return c
        held[np.argmax(np.where(back, np.abs(slope), 0.0))] = False
    root = np.linalg.cholesky(a)
    bounds = (np.minimum(low, high - 1e-12), high)
    found = lsq_linear(root.T, np.linalg.solve(root, b), bounds=bounds, method="bvls").x
    return np.asarray(np.clip(found, low, high))
