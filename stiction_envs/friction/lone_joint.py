"""Compiled Single Joint Experiment of one joint without its arm: fast enough for a search.

It has the friction law, step and torque path of the whole arm (LuGre, 1 ms, semi-implicit Euler,
bristle torque from the old deflection) without the other joints, ripple and offset. One column is
one simulation. It is used for *searches* only: every reported number is simulated again by the
plant with the whole arm (`gap.tables` corrects the difference between the two and repeats).

    rotor   J_r dω/dt = u − τ_f(z, ω) − K(θ − q) − D(ω − v)
    link    J_l dv/dt = K(θ − q) + D(ω − v)

A rigid joint (K = inf) is a rotor that carries the link.
"""

from dataclasses import dataclass, fields

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled
from stiction_envs.friction.parameters import CONTROL_DT


@dataclass(kw_only=True)
class LoneJoints:
    """Parameters of C lone joints, each (C,), SI units."""

    stiction: Array  # F_s [N·m]
    coulomb_ratio: Array  # F_c/F_s [-]
    stribeck_velocity: Array  # v_s [rad/s]
    bristle_stiffness: Array  # σ0 [N·m/rad]
    bristle_damping: Array  # σ1 [N·m·s/rad]
    viscous: Array  # σ2 [N·m·s/rad]
    rotor_inertia: Array  # J_r [kg·m²]
    joint_stiffness: Array  # K [N·m/rad]; inf is rigid
    joint_damping: Array  # D [N·m·s/rad]
    link_inertia: Array  # J_l [kg·m²]
    amplitude: Array  # Dither [N·m]
    frequency: Array  # Dither [Hz]
    ramp_rate: Array  # [N·m/s]
    lowpass_hz: Array  # Cut-off of the first-order low-pass on the command [Hz]; inf is off
    torque_rate: Array  # Largest change of the command [N·m/s]; inf is off


def breakaway(joints: LoneJoints, *, threshold: float, longest: float, hold: int = 1) -> Array:
    """Return (C,) ramp torque at which each joint's link has moved by ``threshold`` [rad]: [N·m].

    NaN where a joint has not moved within ``longest`` [s]. Commands are held for ``hold`` steps.
    """
    columns = np.ascontiguousarray(np.stack([getattr(joints, f.name) for f in fields(joints)], 1))
    return _breakaway(columns, threshold, round(longest / CONTROL_DT), hold)


@compiled
def bristle_after(deflection, speed, decay, step):  # type: ignore[no-untyped-def]
    """Return the deflection after a step at constant speed, as MuJoCo's ``dcmotor`` integrates it.

    Exact solution of ż = v − |v| σ0/g z: ``deflection`` is z [rad], ``speed`` v [rad/s], ``decay``
    |v| σ0/g times the step, above 0 [-].
    """
    e = np.expm1(-decay)
    return deflection + (e * deflection - e / decay * step * speed)


@compiled
def _breakaway(columns: Array, threshold: float, steps: int, hold: int) -> Array:
    """Return `breakaway` of (C, fields) parameters, in the order of `LoneJoints`."""
    out = np.full(len(columns), np.nan)
    for i in range(len(columns)):
        c = columns[i]
        stiction, coulomb_ratio, stribeck_velocity, stiffness, damping, viscous = c[:6]
        rotor, spring, spring_damping, link, amplitude, frequency, rate = c[6:13]
        lowpass_hz, torque_rate = c[13:]
        elastic = np.isfinite(spring)
        gain = CONTROL_DT / (CONTROL_DT + 1 / (2 * np.pi * lowpass_hz))
        most = torque_rate * CONTROL_DT
        coulomb = stiction * coulomb_ratio
        drop = stiction - coulomb
        # a rigid joint is a rotor that carries the link
        per_inertia = CONTROL_DT / (rotor if elastic else rotor + link)
        per_link = CONTROL_DT / link
        # rotor, link: angle and speed; bristle; filtered and rate-limited command
        theta, w, q, v, z, y, x = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        # Ramps start at zero: under dither a joint creeps from the first second, far below
        # breakaway, and a later start would change the result by up to 17 %.
        for k in range(steps):
            if k % hold == 0:
                t = k * CONTROL_DT
                ramp = rate * t
                u = ramp + amplitude * np.sin(2 * np.pi * frequency * t)
            x += max(-most, min(most, u - x))
            y += gain * (x - y)
            # g(ω), level of steady sliding
            g = coulomb + drop * np.exp(-((w / stribeck_velocity) ** 2))
            # a: decay rate of the bristle times h; a floor far below any effect avoids 0/0
            a = max(abs(w) * stiffness * CONTROL_DT / g, 1e-15)
            push = y - stiffness * z + damping * (a / CONTROL_DT * z - w) - viscous * w
            z = bristle_after(z, w, a, CONTROL_DT)
            if elastic:
                pull = spring * (theta - q) + spring_damping * (w - v)
                push -= pull
                v += per_link * pull
            w += per_inertia * push
            theta += CONTROL_DT * w
            if elastic:
                q += CONTROL_DT * v
            if (q if elastic else theta) >= threshold:
                out[i] = ramp
                break
    return out
