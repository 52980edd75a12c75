"""The path of a joint, for effects that depend on its reversals: friction, hysteresis, play.

The low-pass of all signals overshoots by 0.1 mrad and more where a joint stops. Friction with a
shorter presliding distance would reverse there, and noise would change it at rest. The path
therefore passes a wider low-pass, and play removes the remaining noise: the path follows the angle
only when it has left a band about the path.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]
WIDER = 3.0
"""Cutoff for these angles over the cutoff for all signals [-]: measured: of 1, 1.5, 2, 3
and 5 the best for known friction at stops of simulated joints."""


def angle_noise(q: Array) -> float:
    """Return the standard deviation of white noise on even samples of an angle (K,) [rad].

    In its fourth differences motion below a tenth of the sampling rate is negligible. The
    squares of their weights sum to 1² + 4² + 6² + 4² + 1² = 70. The largest tenth (jumps and
    collisions) is left out, which for normal noise leaves 0.62 of the variance.
    """
    if len(q) < 16:
        return 0.0
    bend = np.square(np.diff(q, 4))
    kept = np.sort(bend)[: max(1, int(0.9 * len(bend)))]
    return float(np.sqrt(kept.mean() / 0.62 / 70))


@compiled
def play(x: Array, half: Array) -> Array:
    """Return (T, K) outputs of play with half widths ``half`` (K,), starting at x[0].

    Args:
        x: (T,) input path, the middle of the play.
        half: (K,) half widths from 0, in units of the path; 0 gives the path itself.
    """
    out = np.empty((len(x), len(half)))
    pen = np.full(len(half), x[0] if len(x) else 0.0)
    for i in range(len(x)):
        for k in range(len(half)):
            pen[k] = min(max(pen[k], x[i] - half[k]), x[i] + half[k])
            out[i, k] = pen[k]
    return out


def reversal_path(
    q: Array,
    rate_hz: float,
    cutoff_hz: float,
    lowpass: Callable[[Array, float, float], Array],
) -> Array:
    """Return (K,) the angles of a joint without overshoot and reversals caused by noise [rad].

    The play's half width is the standard deviation of the noise that is left: of 0, 1 and 2 the
    best, as for `WIDER`.

    Args:
        q: (K,) even samples of its angle [rad].
        rate_hz: their rate [Hz].
        cutoff_hz: cutoff of the filter of all signals [Hz].
        lowpass: that filter, a function of samples, rate and cutoff.
    """
    wide = min(WIDER * cutoff_hz, rate_hz / 2)
    left = angle_noise(q) * np.sqrt(2 * wide / rate_hz)
    return np.asarray(play(lowpass(q, rate_hz, wide), np.array([left]))[:, 0])
