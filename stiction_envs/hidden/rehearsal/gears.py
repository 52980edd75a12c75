"""A link behind a soft gear whose motor moves as a log says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, mass_matrices

Array = NDArray[np.float64]
DAMPING = 0.1
"""Damping ratio of a soft gear [-]; assumed."""
TURN = 0.1
"""Largest angle by which a link behind a gear swings in a step [rad]; assumed: the error of its
frequency is below 0.1 %."""


def link_behind_gear(data: Data, joint: int, stiffness: float) -> tuple[Array, Array]:
    """Return (T,) the link's angle less the motor's, δ [rad], and its speed [rad/s].

    M δ̈ = −L − K δ − D δ̇, where L is the load at the link's angle, to first order in δ.

    Args:
        data: the motor's motion.
        joint: from 0.
        stiffness: K of the gear [N·m/rad].
    """
    model, nudge = data.pinocchio, 1e-5
    mass = mass_matrices(model, data.q)[:, joint, joint]
    moved = np.array(data.q)
    moved[:, joint] += nudge
    load = data.recording.rigid[:, joint]
    slope = (inverse_dynamics(model, moved, data.dq, data.ddq)[:, joint] - load) / nudge
    steps = int(np.ceil(np.sqrt(stiffness / mass.min()) * data.dt / TURN))
    out = np.zeros((len(mass), 2))
    for run in data.runs():
        swing(load[run], slope[run], mass[run], stiffness, DAMPING, data.dt, steps, out[run])
    return out[:, 0], out[:, 1]


@compiled
def swing(
    load: Array,
    slope: Array,
    mass: Array,
    stiffness: float,
    ratio: float,
    dt: float,
    steps: int,
    out: Array,
) -> None:
    """Put δ and its speed into ``out`` (K, 2), from rest on the gear; semi-implicit Euler."""
    x = -load[0] / stiffness
    v, h = 0.0, dt / steps
    out[0, 0] = x
    for k in range(1, len(load)):
        for s in range(steps):
            part = (s + 1) / steps
            now = load[k - 1] + part * (load[k] - load[k - 1])
            force = -now - slope[k] * x - stiffness * x
            force -= 2 * ratio * np.sqrt(stiffness * mass[k]) * v
            v += h * force / mass[k]
            x += h * v
        out[k, 0], out[k, 1] = x, v
