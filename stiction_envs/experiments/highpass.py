"""The high-pass that separates an arm's vibration from its motion: SciPy's, without SciPy.

`scipy.signal` takes longer to load than an environment takes to make. Both functions compute what
`scipy.signal.butter` and `scipy.signal.sosfilt` do, in the same order: the same bits.
"""

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled


def butterworth_highpass(cutoff_hz: float, rate_hz: float) -> Array:
    """Return the Butterworth high-pass of second order as (1, 6) b0, b1, b2, 1, a1, a2.

    The analog poles are turned into a high-pass at the warped cut-off, where the gain is 1/√2, and
    go through the bilinear transform, whose rate is set to 2.
    """
    warped = 4.0 * np.tan(np.pi * (2.0 * cutoff_hz / rate_hz) / 2.0)
    prototype = -np.exp(1j * np.pi * np.array([-1.0, 1.0]) / 4.0)
    poles = warped / prototype
    gain = np.real(1.0 / np.prod(-prototype)) * np.real(16.0 / np.prod(4.0 - poles))
    digital = (4.0 + poles) / (4.0 - poles)
    return np.concatenate([gain * np.poly([1.0, 1.0]), np.real(np.poly(digital))])[None]


@compiled
def filter_sections(sections: Array, x: Array, state: Array) -> None:
    """Filter x (..., K), C-contiguous, along its last axis, in place; the states run on.

    Sections (S, 6) are those of `butterworth_highpass`; ``state`` (S, ..., 2), changed, is zeros
    for a signal that was zero for long.
    """
    rows = x.reshape(-1, x.shape[-1])
    z = state.reshape(len(sections), -1, 2)
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            value = rows[i, k]
            for s in range(len(sections)):
                b0, b1, b2, _, a1, a2 = sections[s]
                new = b0 * value + z[s, i, 0]
                z[s, i, 0] = b1 * value - a1 * new + z[s, i, 1]
                z[s, i, 1] = b2 * value - a2 * new
                value = new
            rows[i, k] = value
