"""Dither that fades where a joint moves: exp(−(q̇/v_gate)²) at the controller's rate.

Amplitude as a function of velocity is future work in section 6.1 of the thesis. q̇ includes the
motion the dither itself causes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError

Floats = NDArray[np.float64]


def gate_factor(gate_velocity: Floats) -> Floats | None:
    """Return 1/v_gate (N, n) [s/rad] of gate velocities [rad/s]; None where all are infinite."""
    return 1.0 / gate_velocity if np.isfinite(gate_velocity).any() else None


def fade(torque: Floats, qd: Floats | None, factor: Floats) -> None:
    """Multiply a dither torque (N, n) [N·m] in place by exp(−(q̇/v_gate)²).

    Args:
        torque: the dither without its offset.
        qd: joint velocities (N, n) [rad/s].
        factor: of :func:`gate_factor`.

    Raises:
        StictionError: velocities missing or of another shape.
    """
    if qd is None or qd.shape != torque.shape:
        got = None if qd is None else qd.shape
        raise StictionError(f"gated dither: qd has shape {got}: expected {torque.shape}")
    g = np.multiply(qd, factor, out=np.empty(torque.shape))
    torque *= np.exp(np.negative(np.square(g, out=g), out=g), out=g)
