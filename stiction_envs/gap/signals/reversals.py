"""The path of a joint between its reversals, from even samples of its angle.

Effects that depend on reversals are friction, hysteresis and play. The low-pass of all signals
overshoots by 0.1 mrad and more where a joint stops. Friction with a shorter presliding distance
would reverse there, and noise would change it at rest. The path therefore passes a wider low-pass,
and turns back within the remaining noise are left out.
"""

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled
from stiction_envs.filters import lowpass

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
def zigzag(x: Array, band: float) -> Array:
    """Return (K,) a path without its turns back of ``band`` or less.

    A turn counts once the path has gone back by more than the band. It is then where the path was
    farthest, so that turns do not come late; between turns the path never goes back.

    Args:
        x: (K,) path.
        band: width of the turns that are left out, in units of the path.
    """
    out, start, side = x.copy(), 0, 0.0
    low, high = 0, 0
    for i in range(1, len(x)):
        if x[i] > x[high]:
            high = i
        if x[i] < x[low]:
            low = i
        if side >= 0 and x[high] - x[i] > band:  # it was rising, or not yet moving
            for k in range(start + 1, high + 1):
                out[k] = max(out[k], out[k - 1])
            start, low, side = high, i, -1.0
        elif side <= 0 and x[i] - x[low] > band:
            for k in range(start + 1, low + 1):
                out[k] = min(out[k], out[k - 1])
            start, high, side = low, i, 1.0
    for k in range(start + 1, len(x)):
        out[k] = out[k - 1] if side == 0 else side * max(side * out[k], side * out[k - 1])
    return out


def reversal_path(q: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Return (K,) the angles of a joint without overshoot and reversals caused by noise [rad].

    Turns back within four standard deviations of the noise that is left are none.

    Args:
        q: (K,) even samples of its angle [rad].
        rate_hz: their rate [Hz].
        cutoff_hz: cutoff of the filter of all signals [Hz].
    """
    wide = min(WIDER * cutoff_hz, rate_hz / 2)
    left = angle_noise(q) * np.sqrt(2 * wide / rate_hz)
    return zigzag(lowpass(q, rate_hz, wide), 4 * left)
