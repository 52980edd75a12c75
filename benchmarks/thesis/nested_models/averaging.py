"""What theory says dither does to a joint: averaged friction, and presliding as a spring.

Nothing here is fitted or simulated in time: each function is one formula with its source, drawn
over the simulation as a check. Three pictures of one joint under a ramp and a dither torque
A sin 2πft:

| picture | holds where | ramp torque at which the joint has moved |
|---|---|---|
| sliding to and fro | A ≫ F, many periods per ramp | `averaged_breakaway` |
| shaken bristles | the joint sticks, its LuGre bristles creep: A·gain ≪ F | `creep_breakaway` |
| bristles as a spring | the first slip of a joint that sticks | F − A·gain |

All arguments broadcast. SI units: N·m, rad, s, Hz, kg·m². Symbols: A and f (amplitude and
frequency of the dither); J_r, J_l, K, D, Z (inertia of rotor and link, stiffness and damping of the
joint, impedance at the rotor); F_s, F_c, F, v_s (stiction, Coulomb friction, one level, Stribeck
velocity); σ0, σ1 (stiffness and damping of the bristles); V (peak speed of the shaking); r, θ (rate
of the ramp, threshold).

Sources: Zames and Shneydor 1976, *Dither in nonlinear systems*, IEEE TAC 21; Iannelli, Johansson,
Jönsson, Vasca 2006, *Averaging of nonsmooth systems using dither*, Automatica 42; Pervozvanski and
Canudas de Wit 2002, *Asymptotic analysis of the dither effect in systems with friction*, Automatica
38; Canudas de Wit, Olsson, Åström, Lischinsky 1995 (LuGre), IEEE TAC 40.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Value = Array | float
_QUARTER = (np.arange(720) + 0.5) / 720 * np.pi / 2
"""Phases of a quarter period [rad], their number assumed: |cos| repeats over the others."""


def impedance(
    frequency: Value,
    *,
    rotor_inertia: Value,
    link_inertia: Value = 0.0,
    joint_stiffness: Value = np.inf,
    joint_damping: Value = 0.0,
) -> Complex:
    """Return the joint's mechanical impedance at the rotor, torque over speed [N·m·s/rad].

    Spring and link share a torque, and their speeds add up to the rotor's, so their admittances add
    (two-mass system of `friction.lone_joint`):

        Z(ω) = iωJ_r + 1 / (1/(K/(iω) + D) + 1/(iωJ_l))

    A rigid joint (K = inf) is iω(J_r + J_l).
    """
    iw = 2j * np.pi * np.asarray(frequency, float)
    link = iw * link_inertia
    rigid = np.isinf(joint_stiffness)
    spring = np.where(rigid, 0.0, joint_stiffness) / iw + joint_damping
    both = link + spring
    behind = np.where(rigid, link, link * spring / np.where(both == 0, 1.0, both))
    return np.asarray(iw * rotor_inertia + behind)


def speed_amplitude(amplitude: Value, impedance: Complex, coulomb: Value = 0.0) -> Array:
    """Return the peak speed V of the rotor under a torque A sin 2πft [rad/s].

    Free: V = A/|Z|, for a rigid joint A/(Jω) (sources.md 4.2). With Coulomb friction of level F,
    whose first harmonic at a sine of speed is 4F/π in phase with it (describing function), the
    torques balance when |Z V + 4F/π| = A. There is no such V for A ≤ 4F/π: the joint sticks during
    most of a period.
    """
    load, size = 4 / np.pi * coulomb, np.abs(impedance) ** 2
    drive = np.maximum(np.square(amplitude) - load**2, 0.0)
    real = np.real(impedance) * load
    return np.asarray((np.sqrt(real**2 + size * drive) - real) / size)


def lowpass(frequency: Value, cutoff: float, step: float = 1e-3) -> Complex:
    """Return the response of the robot's low-pass y ← y + g(u − y) to a sine [-].

        H(ω) = g / (1 − (1 − g) e^(−iωΔt)),  g = Δt/(Δt + 1/(2πf_c))

    Its magnitude is the gain, its angle the phase [rad] (sources.md 1.8).
    """
    gain = step / (step + 1 / (2 * np.pi * cutoff))
    delay = np.exp(-2j * np.pi * np.asarray(frequency, float) * step)
    return np.asarray(gain / (1 - (1 - gain) * delay))


def slide(
    inertia: Value, ramp_rate: float, distance: Value, *, speed: Value = 0.0, excess: Value = 0.0
) -> Array:
    """Return by how much the ramp still grows while a freed joint slides to the threshold [N·m].

    Once friction can no longer hold the joint, the torque beyond it is r t and what friction has
    dropped by: J dv/dt = e + r t. The joint has slid by d after the t of

        r t³/6J + e t²/2J + v t = d,

    and the ramp has grown by r t; without e and v that is r ∛(6Jd/r) (sources.md 3.2: 2-15 % of
    F_s). Viscous friction is left out.
    """
    j, d, v, e = np.broadcast_arrays(inertia, distance, speed, excess)
    low, high = np.zeros(j.shape), np.cbrt(6 * j * d / ramp_rate)
    for _ in range(60):  # bisection: the left side rises with t
        t = (low + high) / 2
        short = ramp_rate * t**3 / 6 + e * t**2 / 2 + j * v * t < j * d
        low, high = np.where(short, t, low), np.where(short, high, t)
    return np.asarray(ramp_rate * high)


def ramp_peak(
    stiction: float,
    coulomb: float,
    stribeck_velocity: float,
    bristle_stiffness: float,
    ramp_rate: float,
) -> float:
    """Return the torque at which a LuGre joint without dither lets go under a ramp [N·m].

    Its bristles must follow the ramp, dz/dt = r/σ0 = v(1 − τ/g(v)), so it creeps at v when the ramp
    is at τ, and friction has already begun to fall:

        τ_peak = max over v of g(v)(1 − r/(σ0 v)),

    F_s for a slow ramp, F_c for a fast one, noticeably less than F_s once r/σ0 is some hundredths
    of v_s (Ruderman 2016 measured the like, sources.md 3.2; derived here).
    """
    least = ramp_rate / bristle_stiffness
    v = least * np.geomspace(1.0, 1e7, 2000)
    level = coulomb + (stiction - coulomb) * np.exp(-np.square(v / stribeck_velocity))
    return float((level * (1 - least / v)).max())


def averaged_breakaway(
    coulomb: Value, speed_amplitude: Value, ramp_rate: float, threshold: float, inertia: Value = 0.0
) -> Array:
    """Return what the Single Joint Experiment would read if averaging were all [N·m].

    Under a ramp τ = r t the averaged friction of a sine, (2F/π) asin(v/V) (sources.md 4.1),
    balances the ramp at the slow speed v = V sin(πτ/2F): a stuck joint has become a viscous one.
    The slow motion's own inertia is left out. The reading is the ramp when the joint has moved by
    θ:

        θ = ∫ V sin(π r t/2F) dt = (2FV/πr)(1 − cos(πτ/2F))
        τ = (2F/π) acos(1 − x),   x = π r θ/(2FV)

    For V → ∞ that is 0, as (2F/π)√(2x). At x = 1 the ramp has come to F, where friction is used up:
    for x ≥ 1, and with it for V → 0, the reading is F and the `slide` over what is left of θ.
    (Averaging and the protocol of thesis 3.2; derived here.)
    """
    crept = 2 * coulomb * np.asarray(speed_amplitude) / (np.pi * ramp_rate)
    x = np.minimum(threshold / np.maximum(crept, 1e-12), 1.0)
    left = np.maximum(threshold - crept, 0.0)
    slid = slide(inertia, ramp_rate, left, speed=speed_amplitude)
    return np.asarray(2 * coulomb / np.pi * np.arccos(1 - x) + slid)


def presliding_gain(
    frequency: Value, *, bristle_stiffness: Value, bristle_damping: Value, impedance: Complex
) -> Array:
    """Return the bristles' torque amplitude over the dither's, for a joint that sticks [-].

    A stuck joint hangs on its bristles, a spring σ0 with damping σ1 (LuGre at |z| ≪ F/σ0, where
    dz/dt = v). Of the dither σ0 / |σ0 + iωσ1 + iωZ| arrives at the friction, for a rigid joint
    σ0/|σ0 − Jω² + iσ1ω| (sources.md 4.3).
    """
    w = 2 * np.pi * np.asarray(frequency, float)
    dynamic = bristle_stiffness + 1j * w * (bristle_damping + impedance)
    return np.asarray(bristle_stiffness / np.abs(dynamic))


def bristle_speed(
    amplitude: Value, frequency: Value, gain: Value, bristle_stiffness: Value
) -> Array:
    """Return the peak speed of a joint that sticks and is shaken, ωA·gain/σ0 [rad/s]."""
    reach = np.asarray(amplitude, float) * gain
    return np.asarray(2 * np.pi * np.asarray(frequency, float) * reach / bristle_stiffness)


def shaken_level(
    stiction: float, coulomb: float, stribeck_velocity: float, speed_amplitude: Value
) -> Array:
    """Return the level that a shaken LuGre joint has on average [N·m].

    The bristles relax at the rate σ0|v|/g(v); under v = V cos ωt the mean rate is that of

        g̅ = mean|v| / mean(|v|/g(v)),   g(v) = F_c + (F_s − F_c) e^(−(v/v_s)²),

    which is F_s for V ≪ v_s and F_c for V ≫ v_s: at any frequency, shaking takes away what makes
    static friction larger than kinetic, and no more. (Average of LuGre, Canudas de Wit et al. 1995,
    over a fast oscillation as in Pervozvanski and Canudas de Wit 2002; derived here.)
    """
    shape = np.cos(_QUARTER)
    speed = np.asarray(speed_amplitude, float)[..., None] * shape
    level = coulomb + (stiction - coulomb) * np.exp(-np.square(speed / stribeck_velocity))
    return np.asarray(shape.mean() / (shape / level).mean(axis=-1))


@cache
def _creep() -> tuple[Array, Array]:
    """Return x = ∫ u dh and h over u from 0 to 1: see `creep_breakaway`."""
    u = np.sin(np.linspace(0, np.pi / 2, 4001))
    h = np.pi * u / (2 * (np.sqrt(1 - u**2) + u * np.arcsin(u)))
    return np.concatenate([[0.0], np.cumsum((u[1:] + u[:-1]) / 2 * np.diff(h))]), h


def creep_breakaway(
    level: Value,
    speed_amplitude: Value,
    ramp_rate: float,
    threshold: float,
    inertia: Value = 0.0,
    drop: Value = 0.0,
) -> Array:
    """Return what the experiment would read of a joint whose shaken bristles creep [N·m].

    Averaged over the oscillation, a bristle obeys dz/dt = v̄ − σ0 z mean|v|/g. In balance with the
    ramp, τ = σ0 z, it lets the joint creep at v̄ = V u with

        τ/g = u / mean|u + cos| = πu/(2(√(1 − u²) + u asin u)) = h(u),   0 ≤ u ≤ 1,

    viscous at first, τ = (π/2) g v̄/V, and g at u = 1. The joint has moved by θ when

        θ r/(V g) = ∫ u dh,

    at most 0.37 (at τ = g); beyond, and for V → 0, the reading is g and the `slide` over what is
    left of θ, with friction falling by ``drop`` below g. The g to use is `shaken_level`. An
    elasto-plastic joint does not creep below its elastic limit. (LuGre averaged as in Pervozvanski
    and Canudas de Wit 2002; derived here.)
    """
    x, h = _creep()
    per_x = level * np.asarray(speed_amplitude, float) / ramp_rate
    reach = np.minimum(threshold / np.maximum(per_x, 1e-12), x[-1])
    left = np.maximum(threshold - per_x * x[-1], 0.0)
    slid = slide(inertia, ramp_rate, left, speed=speed_amplitude, excess=drop)
    # h goes as √x at the start
    return np.asarray(level * np.interp(np.sqrt(reach), np.sqrt(x), h) + slid)
