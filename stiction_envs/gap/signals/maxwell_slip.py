"""Maxwell-slip elements along the path of a joint: dry friction that yields bit by bit.

Each element is a spring that slides at its own distance Δ: s' = q̇/Δ within −1 ≤ s ≤ 1. Their sum
is the rate-independent part of the generalised Maxwell-slip model (F. Al-Bender, V. Lampaert,
J. Swevers, "The generalized Maxwell-slip model", IEEE Transactions on Automatic Control 50, 2005).
In contrast to one bristle (Dahl, LuGre), small loops close: it remembers every turn within it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from stiction_envs.compiled import compiled
from stiction_envs.measured.settings import MotionThresholds, measured_settings

Array = NDArray[np.float64]
ELEMENTS = 8
"""Number of elements [-]; assumed: their corners vanish in a filtered log."""
YIELDS = gammaincinv(2.0, (np.arange(ELEMENTS) + 0.5) / ELEMENTS) / 2
"""(ELEMENTS,) distances Δ of equal elements over that of the bristle d [-]: the part of friction
that yields within Δ is 1 − (1 + 2Δ/d) e^(−2Δ/d), so that after a full reversal the sum is that of
Dahl's bristle, 1 − 2 e^(−x/d)."""


def maxwell_slip(
    path: Array, runs: list[slice], distance: Array, motion: MotionThresholds | None = None
) -> Array:
    """Return (T, k) torque of the elements over its steady level, for k distances [-].

    Args:
        path: (T,) of one joint [rad].
        runs: rows of each segment; the state before one is as of `bristle.bristles`.
        distance: (k,) d of a bristle with the same full reversal [rad].
        motion: when a joint moves from the start; None for ``settings.toml``'s.
    """
    moves = motion or measured_settings().motion
    yields, out = np.multiply.outer(distance, YIELDS), np.zeros((len(path), len(distance)))
    for run in runs:
        x = path[run]
        steps = np.diff(x)
        if not steps.any():
            continue
        begun = abs(x[min(moves.start_samples, len(x) - 1)] - x[0]) > moves.start_span
        start = float(np.sign(steps[np.flatnonzero(steps)[0]])) * begun
        _slide(steps, yields, start, out[run])
    return out


@compiled
def _slide(steps: Array, yields: Array, start: float, out: Array) -> None:
    """Write the mean of elements (k, m) that move by steps (K − 1,) into ``out`` (K, k)."""
    s = np.full(yields.shape, start)
    out[0] = start
    for i in range(len(steps)):
        for k in range(yields.shape[0]):
            total = 0.0
            for m in range(yields.shape[1]):
                s[k, m] = min(max(s[k, m] + steps[i] / yields[k, m], -1.0), 1.0)
                total += s[k, m]
            out[i + 1, k] = total / yields.shape[1]
