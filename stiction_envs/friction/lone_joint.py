"""The Single Joint Experiment of a lone joint, thousands at once in numpy: fast enough to search.

The friction law, step and torque path of the whole arm (`friction.law`, 1 ms, semi-implicit Euler,
bristle torque from the old deflection) without the other joints, ripple and offset. One column is
one simulation. It only *searches*: every number that is reported is simulated again by the plant
with the whole arm (`gap.table_fit` corrects the difference between the two and repeats).

    rotor   J_r dω/dt = u − τ_f(z, ω) − K(θ − q) − D(ω − v)
    link    J_l dv/dt = K(θ − q) + D(ω − v)

A rigid joint (K = inf) is a rotor that carries the link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP = 1e-3
"""Control and physics step [s]."""
CHUNK = 200
"""Steps between two looks at which joints have moved."""


@dataclass(kw_only=True)
class LoneJoints:
    """Parameters of C lone joints, each (C,), SI units."""

    stiction: Array
    """F_s [N·m]."""
    coulomb_ratio: Array
    """F_c/F_s [-]."""
    stribeck_velocity: Array
    """v_s [rad/s]."""
    bristle_stiffness: Array
    """σ0 [N·m/rad]."""
    bristle_damping: Array
    """σ1 [N·m·s/rad]."""
    viscous: Array
    """σ2 [N·m·s/rad]."""
    rotor_inertia: Array
    """J_r [kg·m²]."""
    joint_stiffness: Array
    """K [N·m/rad]; inf is rigid."""
    joint_damping: Array
    """D [N·m·s/rad]."""
    link_inertia: Array
    """J_l [kg·m²]."""
    amplitude: Array
    """Dither [N·m]."""
    frequency: Array
    """Dither [Hz]."""
    ramp_rate: Array
    """[N·m/s]."""
    lowpass_hz: Array
    """Cut-off of the first-order low-pass on the command [Hz]; inf is off."""
    torque_rate: Array
    """Largest change of the command [N·m/s]; inf is off."""
    breakaway_ratio: Array
    """Elasto-plastic: deflection below which presliding is purely elastic, over that of steady
    sliding [-]; 0 is LuGre (Dupont, Hayward, Armstrong, Altpeter 2002)."""

    def pick(self, keep: NDArray[np.bool_]) -> LoneJoints:
        """Return some columns."""
        return LoneJoints(**{k: v[keep] for k, v in vars(self).items()})


def breakaway(joints: LoneJoints, *, threshold: float, longest: float, hold: int = 1) -> Array:
    """Return (C,) ramp torque at which each joint's link has moved by the threshold [N·m].

    Args:
        joints: the joints.
        threshold: [rad].
        longest: ramps end here [s].
        hold: steps for which a command is held.

    Returns:
        Torques; NaN where the joint did not move.
    """
    c = joints
    out = np.full(len(c.stiction), np.nan)
    index = np.arange(len(out))
    # ramps start at zero: under dither a joint creeps from the first second, far below breakaway,
    # and a later start would change the reading by up to 17 %
    # theta, omega, z, q, v, filtered command, rate-limited command
    state = np.zeros((7, len(out)))
    for k in range(0, int(longest / STEP), CHUNK):
        tick = (k + np.arange(CHUNK)) // hold * hold
        t = tick[:, None] * STEP
        ramp = c.ramp_rate * t
        command = ramp + c.amplitude * np.sin(2 * np.pi * c.frequency * t)
        moved = _chunk(c, state, command, threshold, hold)
        done = moved.any(axis=0)
        if done.any():
            first = moved.argmax(axis=0)
            out[index[done]] = ramp[first, np.arange(len(first))][done]
            keep: NDArray[np.bool_] = np.logical_not(done)
            c, state, index = c.pick(keep), state[:, keep], index[keep]
            if not len(index):
                break
    return out


def _chunk(
    c: LoneJoints, state: Array, command: Array, threshold: float, hold: int
) -> NDArray[np.bool_]:
    """Advance all columns by one chunk in place; return (CHUNK, C) whether the link has moved."""
    theta, w, z, q, v, y, x = state
    moved = np.empty(command.shape, dtype=bool)
    gain = STEP / (STEP + 1 / (2 * np.pi * c.lowpass_hz))
    most = c.torque_rate * STEP
    # steps of a held sine are at most 2πfA h; where none comes near the limit it is left out
    steepest = (2 * np.pi * c.frequency * c.amplitude + c.ramp_rate) * hold * STEP
    limited = bool((steepest > 0.99 * most).any())
    coulomb = c.stiction * c.coulomb_ratio
    drop = c.stiction - coulomb
    elastic = np.isfinite(c.joint_stiffness)
    some_elastic = bool(elastic.any())
    k = np.where(elastic, c.joint_stiffness, 0.0)
    d = np.where(elastic, c.joint_damping, 0.0)
    # a rigid joint is a rotor that carries the link
    per_inertia = STEP / np.where(elastic, c.rotor_inertia, c.rotor_inertia + c.link_inertia)
    per_link = STEP / c.link_inertia
    plastic = bool(c.breakaway_ratio.any())
    # what the loop repeats, in units of v_s and of the step
    per_stribeck, bristle_step = 1.0 / c.stribeck_velocity, c.bristle_stiffness * STEP
    damping_rate = c.bristle_damping / STEP
    slope = c.bristle_damping + c.viscous
    g, a, e, push, term = (np.empty_like(w) for _ in range(5))
    for i, u in enumerate(command):
        if limited:
            np.subtract(u, x, out=term)
            np.minimum(term, most, out=term)
            np.maximum(term, -most, out=term)
            x += term
            u = x
        np.subtract(u, y, out=term)
        term *= gain
        y += term
        # g(ω), level of steady sliding
        np.multiply(w, per_stribeck, out=g)
        np.multiply(g, g, out=g)
        np.negative(g, out=g)
        np.exp(g, out=g)
        g *= drop
        g += coulomb
        # a: decay rate of the bristle times h; a floor far below any effect keeps 0/0 away
        np.abs(w, out=a)
        a *= bristle_step
        a /= g
        if plastic:
            a *= _plasticity(c, z, w, g)
        np.maximum(a, 1e-15, out=a)
        # push = y − σ0 z − σ1 dz/dt − σ2 ω
        np.multiply(damping_rate, a, out=push)
        push -= c.bristle_stiffness
        push *= z
        push += y
        np.multiply(slope, w, out=term)
        push -= term
        # exact solution of the bristle equation at constant speed: friction.law.LuGre.advance
        np.negative(a, out=e)
        np.expm1(e, out=e)
        np.divide(e, a, out=a)
        a *= -STEP
        a *= w
        e *= z
        z += e
        z += a
        if some_elastic:
            np.subtract(theta, q, out=e)
            e *= k
            np.subtract(w, v, out=a)
            a *= d
            e += a
            push -= e
            e *= per_link
            v += e
        push *= per_inertia
        w += push
        np.multiply(w, STEP, out=term)
        theta += term
        if some_elastic:
            np.multiply(v, STEP, out=term)
            q += term
            np.greater_equal(np.where(elastic, q, theta), threshold, out=moved[i])
        else:
            np.greater_equal(theta, threshold, out=moved[i])
    return moved


def _plasticity(c: LoneJoints, z: Array, w: Array, g: Array) -> Array:
    """Return the α(z, v) of the elasto-plastic model, eq. 9 of Dupont et al. 2002 [-]."""
    steady = g / c.bristle_stiffness
    elastic = c.breakaway_ratio * steady
    span = np.maximum(steady - elastic, 1e-12)
    middle = (np.abs(z) - (steady + elastic) / 2) / span
    alpha = 0.5 * (1.0 + np.sin(np.pi * np.clip(middle, -0.5, 0.5)))
    lugre = c.breakaway_ratio == 0
    return np.where(lugre, 1.0, np.where(z * w < 0, 0.0, alpha))
