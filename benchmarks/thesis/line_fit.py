"""The thesis's least squares (equation 3.1): friction torque against speed, a line per direction.

m = (N Σ(q̇ τ_f) − Σq̇ Στ_f) / (N Σq̇² − (Σq̇)²)
b = (Στ_f Σq̇² − Σq̇ Σ(q̇ τ_f)) / (N Σq̇² − (Σq̇)²)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Line:
    """One joint in one direction."""

    joint: int
    """From 1."""
    direction: str
    """+ or -."""
    rows: int
    intercept: float
    """b [N·m]."""
    slope: float
    """m [N·m·s/rad]."""
    r2: float
    """Coefficient of determination [-]."""


def line(speed: Array, torque: Array) -> tuple[float, float, float]:
    """Return (m, b, R²) of equation 3.1 for N samples; NaN where it has no solution.

    Args:
        speed: (N,) [rad/s].
        torque: (N,) friction torque [N·m].
    """
    n = len(speed)
    below = n * float(speed @ speed) - float(speed.sum()) ** 2
    if n < 3 or below <= 1e-12 * n * n:
        return np.nan, np.nan, np.nan
    m = (n * float(speed @ torque) - float(speed.sum() * torque.sum())) / below
    b = float(torque.sum() * (speed @ speed) - speed.sum() * (speed @ torque)) / below
    left = torque - m * speed - b
    about = torque - torque.mean()
    return m, b, 1.0 - float(left @ left) / max(float(about @ about), 1e-300)


def lines_of(speed: Array, torque: Array) -> tuple[Line, ...]:
    """Return the lines of equation 3.1, of every joint + before −.

    Args:
        speed: (K, n) [rad/s].
        torque: (K, n) friction torque [N·m].
    """
    out = []
    for j in range(speed.shape[1]):
        for name, rows in (("+", speed[:, j] > 0), ("-", speed[:, j] < 0)):
            m, b, r2 = line(speed[rows, j], torque[rows, j])
            count = int(rows.sum())
            out.append(Line(joint=j + 1, direction=name, rows=count, intercept=b, slope=m, r2=r2))
    return tuple(out)
