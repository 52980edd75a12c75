"""Compiled sine dither, which nearly every control cycle adds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@compiled
def sine(omega: Array, phase: Array, amplitude: Array, t: Array, out: Array) -> None:
    """Write A sin(ωt + φ) (N, n) [N·m] at times t (N,) [s]; 0 where the amplitude is."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
            if amplitude[i, j] > 0.0:
                out[i, j] = np.sin(omega[i, j] * t[i] + phase[i, j]) * amplitude[i, j]


@compiled
def add_sines(
    omega: Array, phase: Array, amplitude: Array, t: Array, ids: Index, out: Array
) -> None:
    """Add the sines of simulations ids (M,) at times t (M, K) [s] to torques (M, K, n) [N·m]."""
    for row in range(out.shape[0]):
        i = ids[row]
        for k in range(out.shape[1]):
            for j in range(out.shape[2]):
                if amplitude[i, j] > 0.0:
                    value = np.sin(omega[i, j] * t[row, k] + phase[i, j]) * amplitude[i, j]
                    out[row, k, j] += value
