"""A link behind a soft or loose gear whose motor moves as a log says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, mass_matrices

Array = NDArray[np.float64]
FLANK, FLANK_DAMPING = 8000.0, 0.2
"""Stiffness [N·m/rad] and damping ratio [-] of a loose gear's flanks; assumed."""
SPRING_DAMPING = 0.1
"""Damping ratio of a soft gear [-]; assumed."""
TURN = 0.1
"""Largest angle by which a link behind a gear swings in a step [rad]; assumed: the error of its
frequency is below 0.1 %."""


def link_behind_gear(
    data: Data, joint: int, *, gap: float = 0.0, stiffness: float = FLANK
) -> tuple[Array, Array]:
    """Return (T,) the link's angle less the motor's, δ [rad], and its speed [rad/s].

    The link moves freely within the gap, and beyond it on a damped spring of the joint:
    M δ̈ = −L − K(δ − clip δ) − D δ̇, where L is the load at the link's angle, to first order in δ.

    Args:
        data: the motor's motion.
        joint: from 0.
        gap: of the gear [rad].
        stiffness: K of gear or flanks [N·m/rad].
    """
    model, nudge = data.pinocchio, 1e-5
    mass = mass_matrices(model, data.q)[:, joint, joint]
    moved = np.array(data.q)
    moved[:, joint] += nudge
    load = data.recording.rigid[:, joint]
    slope = (inverse_dynamics(model, moved, data.dq, data.ddq)[:, joint] - load) / nudge
    steps = int(np.ceil(np.sqrt(stiffness / mass.min()) * data.dt / TURN))
    damping = FLANK_DAMPING if gap else SPRING_DAMPING
    out = np.zeros((len(mass), 2))
    for run in data.runs():
        swing(load[run], slope[run], mass[run], gap, stiffness, damping, data.dt, steps, out[run])
    return out[:, 0], out[:, 1]


@compiled
def swing(
    load: Array,
    slope: Array,
    mass: Array,
    gap: float,
    stiffness: float,
    ratio: float,
    dt: float,
    steps: int,
    out: Array,
) -> None:
    """Put δ and its speed into ``out`` (K, 2), from rest on the gear; semi-implicit Euler."""
    x = -load[0] / stiffness - np.sign(load[0]) * gap / 2
    v, h = 0.0, dt / steps
    out[0, 0] = x
    for k in range(1, len(load)):
        for s in range(steps):
            part = (s + 1) / steps
            now = load[k - 1] + part * (load[k] - load[k - 1])
            press = x - min(max(x, -gap / 2), gap / 2)
            force = -now - slope[k] * x - stiffness * press
            if press != 0.0:
                force -= 2 * ratio * np.sqrt(stiffness * mass[k]) * v
            v += h * force / mass[k]
            x += h * v
        out[k, 0], out[k, 1] = x, v
