"""The path of a joint, for what depends on its reversals: friction, hysteresis, play.

The low-pass of all signals overshoots where a joint stops, by 0.1 mrad and more, and friction that
builds up within it would turn with it; noise would wear it off at rest. So the path passes a wider
low-pass, and what noise that leaves is taken out by play: it follows the angle only when that has
left a band about it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.gap.settings import ReversalPathSettings, gap_settings

Array = NDArray[np.float64]


def angle_noise(q: Array) -> float:
    """Return the standard deviation of white noise on even samples of an angle (K,) [rad].

    From fourth differences, which any motion below a tenth of the sampling rate hardly has; their
    squares sum up to 1² + 4² + 6² + 4² + 1² = 70. The largest tenth, jumps and collisions, is left
    out, which for normal noise leaves 0.62 of the variance.
    """
    if len(q) < 16:
        return 0.0
    bend = np.square(np.diff(q, 4))
    kept = np.sort(bend)[: max(1, int(0.9 * len(bend)))]
    return float(np.sqrt(kept.mean() / 0.62 / 70))


@compiled
def play(x: Array, half: Array) -> Array:
    """Return (T, K) pens that are dragged along by slots of half widths ``half`` (K,), from x[0].

    Args:
        x: (T,) path of the slots' middle.
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
    settings: ReversalPathSettings | None = None,
) -> Array:
    """Return (K,) the angles of a joint without overshoot and the turns that noise makes [rad].

    Args:
        q: (K,) even samples of its angle [rad].
        rate_hz: their rate [Hz].
        cutoff_hz: of the filter of all signals [Hz].
        lowpass: that filter, of samples, rate and cutoff.
        settings: constants of the method; None for those of ``settings.toml``.
    """
    s = settings or gap_settings().reversal_path
    wide = min(s.wider * cutoff_hz, rate_hz / 2)
    left = angle_noise(q) * np.sqrt(2 * wide / rate_hz)
    return np.asarray(play(lowpass(q, rate_hz, wide), np.array([s.noise_band * left]))[:, 0])
