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


def play(x: Array, half: float) -> Array:
    """Return (K,) a pen that is dragged along by a slot of half width ``half``."""
    return _dragged(x, half) if half > 0 and len(x) else x


@compiled
def _dragged(x: Array, half: float) -> Array:
    """Return `play` of a slot that is not closed."""
    out, pen = np.empty(len(x)), x[0]
    for i in range(len(x)):
        if x[i] - half > pen:
            pen = x[i] - half
        elif x[i] + half < pen:
            pen = x[i] + half
        out[i] = pen
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
    return play(lowpass(q, rate_hz, wide), s.noise_band * left)
