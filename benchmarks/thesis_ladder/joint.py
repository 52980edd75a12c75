"""A single joint's Single Joint Experiment, many at once in numpy: fast enough to fit.

The same law, step and torque path as the whole arm (`friction.law`, 1 ms, semi-implicit Euler,
bristle torque from the old deflection), without the other joints, ripple or offset. A column is
one simulation. What the whole arm makes of fitted parameters is checked by the ladder itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
H = 1e-3
LOWPASS_GAIN = H / (H + 1 / (2 * np.pi * 100.0))
THRESHOLD = 0.15
CHUNK = 250


@dataclass
class Columns:
    """Parameters of all columns, each (C,); SI units."""

    stiction: Array
    ratio: Array
    stribeck: Array
    bristle: Array
    damping: Array
    """σ1."""
    viscous: Array
    rotor: Array
    stiffness: Array
    """Joint spring; inf is rigid."""
    spring_damping: Array
    link: Array
    amplitude: Array
    frequency: Array
    rate: Array

    def pick(self, keep: NDArray[np.bool_]) -> Columns:
        return Columns(**{k: v[keep] for k, v in vars(self).items()})


def breakaway(c: Columns, longest: float) -> Array:
    """Return (C,) ramp torque at which each joint has moved by the threshold [N·m].

    Columns that have not by ``longest`` [s] give NaN.
    """
    out = np.full(len(c.stiction), np.nan)
    index = np.arange(len(out))
    state = np.zeros((6, len(out)))  # theta, omega, z, q, v, filtered command
    for start in range(0, int(longest / H), CHUNK):
        t = (start + np.arange(CHUNK)) * H
        command = c.rate * t[:, None] + c.amplitude * np.sin(2 * np.pi * c.frequency * t[:, None])
        moved = _chunk(c, state, command)
        done = moved.any(axis=0)
        if done.any():
            first = moved.argmax(axis=0)
            out[index[done]] = (c.rate * t[first])[done]
            keep = ~done
            c, state, index = c.pick(keep), state[:, keep], index[keep]
            if not len(index):
                break
    return out


def _chunk(c: Columns, state: Array, command: Array) -> NDArray[np.bool_]:
    """Advance all columns by one chunk in place; return (CHUNK, C) whether the link has moved."""
    theta, w, z, q, v, y = state
    moved = np.empty(command.shape, dtype=bool)
    coulomb = c.stiction * c.ratio
    drop = c.stiction - coulomb
    elastic = np.isfinite(c.stiffness)
    k = np.where(elastic, c.stiffness, 0.0)
    d = np.where(elastic, c.spring_damping, 0.0)
    # a rigid joint is a rotor that carries the link
    inertia = np.where(elastic, c.rotor, c.rotor + c.link)
    for i, u in enumerate(command):
        y += LOWPASS_GAIN * (u - y)
        g = coulomb + drop * np.exp(-np.square(w / c.stribeck))
        a = -c.bristle * np.abs(w) / g
        friction = c.bristle * z + c.damping * (a * z + w) + c.viscous * w
        e = np.expm1(a * H)
        z += e * z + np.where(a < -1e-9, e / np.where(a < -1e-9, a, 1.0), H) * w
        spring = k * (theta - q) + d * (w - v)
        w += H * (y - friction - spring) / inertia
        theta += H * w
        v += H * spring / c.link
        q += H * v
        moved[i] = np.where(elastic, q, theta) >= THRESHOLD
    return moved
