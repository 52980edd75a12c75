"""A filter forwards and backwards over many signals at once.

It computes what `scipy.signal.sosfiltfilt` does, in the same order: the same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]


def zero_phase(x: Array, sections: Array, rest: Array, pad: int) -> Array:
    """Return (T, ...) signals filtered along the first axis, odd at both ends.

    Args:
        x: (T, ...) signals.
        sections: (S, 6) second-order sections.
        rest: (S, 2) their states under a constant one (`scipy.signal.sosfilt_zi`).
        pad: number of samples that are added at each end, fewer than T.
    """
    flat = x.reshape(len(x), -1)
    left, right = flat[pad:0:-1], flat[-2 : -pad - 2 : -1]
    y = np.concatenate([2 * flat[:1] - left, flat, 2 * flat[-1:] - right])
    _filter(y, sections, rest, False)
    _filter(y, sections, rest, True)
    return y[pad : pad + len(x)].reshape(x.shape)


@compiled
def _filter(x: Array, sections: Array, rest: Array, backwards: bool) -> None:
    """Filter (T, k) signals in place, in direct form II transposed, as if they were at rest."""
    last, size = len(x) - 1, x.shape[1]
    first, second = np.empty((len(sections), size)), np.empty((len(sections), size))
    start = x[last if backwards else 0]
    for s in range(len(sections)):
        first[s], second[s] = rest[s, 0] * start, rest[s, 1] * start
    for i in range(last + 1):
        row = x[last - i if backwards else i]
        for s in range(len(sections)):
            b0, b1, b2 = sections[s, 0], sections[s, 1], sections[s, 2]
            a1, a2 = sections[s, 4], sections[s, 5]
            one, two = first[s], second[s]
            for k in range(size):  # inside: the processor takes several signals at once
                before = row[k]
                after = b0 * before + one[k]
                one[k] = b1 * before - a1 * after + two[k]
                two[k] = b2 * before - a2 * after
                row[k] = after
