"""Bounded least squares of a joint's parameters on its measured angle (output error).

Levenberg-Marquardt; every iteration simulates all derivatives, then all steps, in one batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import HIGH, INDEX, LOW, STEP

Array = NDArray[np.float64]
DIFFERENCE = 0.05
"""Difference of a derivative, over the parameter's step [-]; assumed."""
DAMPINGS = np.array([0.1, 1.0, 10.0, 100.0])
"""Damping of the steps that are tried at once, over the last one [-]; assumed."""
LEAST_GAIN = 1e-3
"""A fit ends when the sum of squares falls by less than this share [-]; assumed."""
ROUGH, LAST = 8, 10
"""Iterations of a fit from a start and of each stage, and of all causes together [-]; assumed."""
LESS, AGAIN = 5, 6
"""Iterations without a cause, and after it was taken out or to other rows [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Fitted parameters of one joint."""

    parameters: Array
    """(P,), in the order of `parameters.NAMES`."""
    free: tuple[str, ...]
    """Names of those that were fitted."""
    angle: Array
    """(T,) simulated angle [rad]."""
    error: Array
    """(T,) measured less simulated angle [rad]; 0 in rows that do not count."""

    @property
    def cost(self) -> float:
        """Sum of squares [rad²]."""
        return float(self.error @ self.error)

    def __getitem__(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[INDEX[name]])


def fit(
    motion: JointMotion,
    start: Array,
    free: Sequence[str],
    *,
    counts: NDArray[np.bool_] | None = None,
    iterations: int = 15,
    low: Array = LOW,
    high: Array = HIGH,
) -> Fit:
    """Fit parameters from one start.

    Args:
        motion: of the joint.
        start: (P,) all parameters.
        free: names of those to fit.
        counts: (T,) rows that count; None for all.
        iterations: at most.
        low: (P,) lower bounds.
        high: (P,) upper bounds.
    """
    at = np.array([INDEX[name] for name in free], dtype=np.int64)
    weight = np.ones(len(motion.t)) if counts is None else counts.astype(np.float64)
    best = np.array(start, dtype=np.float64)
    best[at] = np.clip(best[at], low[at], high[at])
    angle = motion.simulate(best[None])[0]
    error = _error(motion, angle, weight)
    cost, damping = float(error @ error), 1e-2
    for _ in range(iterations if len(at) else 0):
        slopes = derivatives(motion, best, at, angle) * weight
        hessian, gradient = slopes @ slopes.T, slopes @ error
        improved = False
        for _ in range(3):
            tried = _steps(best, at, hessian, gradient, damping * DAMPINGS, (low, high))
            angles = motion.simulate(tried)
            errors = [_error(motion, a, weight) for a in angles]
            costs = np.array([e @ e for e in errors])
            k = int(np.argmin(costs))
            if costs[k] < cost:
                improved = True
                break
            damping *= 1e3
        if not improved:
            break
        gain = 1.0 - costs[k] / cost
        best, angle, error, cost = tried[k], angles[k], errors[k], float(costs[k])
        damping = max(damping * DAMPINGS[k], 1e-7)
        if gain < LEAST_GAIN:
            break
    return Fit(parameters=best, free=tuple(free), angle=angle, error=error)


def derivatives(
    motion: JointMotion, parameters: Array, at: NDArray[np.int64], angle: Array
) -> Array:
    """Return (F, T) change of the angle per step of the parameters ``at`` [rad]."""
    varied = np.repeat(parameters[None], len(at), axis=0)
    sign = np.where(parameters[at] + DIFFERENCE * STEP[at] > HIGH[at], -1.0, 1.0)
    varied[np.arange(len(at)), at] += sign * DIFFERENCE * STEP[at]
    change = motion.simulate(varied) - angle
    change = np.nan_to_num(change, posinf=0.0, neginf=0.0)
    return np.asarray(change * (sign / DIFFERENCE)[:, None])


def _error(motion: JointMotion, angle: Array, weight: Array) -> Array:
    """Return measured less simulated angle; a joint that diverged is a turn off [rad]."""
    return np.asarray(np.clip(np.nan_to_num(motion.q - angle, nan=6.0), -6.0, 6.0) * weight)


def _steps(
    best: Array,
    at: NDArray[np.int64],
    hessian: Array,
    gradient: Array,
    dampings: Array,
    bounds: tuple[Array, Array],
) -> Array:
    """Return one set of parameters per damping; those on a bound that push outward stay."""
    low, high = bounds[0][at], bounds[1][at]
    out = np.repeat(best[None], len(dampings), axis=0)
    diagonal = np.diag(np.diag(hessian) + 1e-15)
    for row, damping in zip(out, dampings, strict=True):
        moving = np.ones(len(at), dtype=bool)
        for _ in range(len(at)):
            x = np.zeros(len(at))
            m = np.flatnonzero(moving)
            if len(m) == 0:
                break
            x[m] = np.linalg.solve((hessian + damping * diagonal)[np.ix_(m, m)], gradient[m])
            new = best[at] + x * STEP[at]
            outward = (new < low) & (best[at] <= low) | (new > high) & (best[at] >= high)
            if not (outward & moving).any():
                break
            moving &= ~outward
        row[at] = np.clip(best[at] + x * STEP[at], low, high)
    return out
