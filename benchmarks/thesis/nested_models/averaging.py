"""What theory says dither does to a joint: averaged friction, presliding as a spring, a bare band.

Nothing here is fitted and nothing is simulated in time: each function is one formula with its
source, drawn over the simulation as a check. Four pictures of one joint under a ramp and a dither
torque A sin 2πft:

| picture | holds where | ramp torque at which the joint has moved |
|---|---|---|
| sliding to and fro | A ≫ F, many periods per ramp | `averaged_breakaway` |
| shaken bristles | the joint sticks, its LuGre bristles creep: A·gain ≪ F | `creep_breakaway` |
| bristles as a spring | the first slip of a joint that sticks | `bristle_breakaway` |
| bare band | no inertia, no bristles: the torques simply add | `band_breakaway` |

All arguments broadcast. SI units: N·m, rad, s, Hz, kg·m².

Sources: Zames and Shneydor 1976, *Dither in nonlinear systems*, IEEE TAC 21; Iannelli, Johansson,
Jönsson, Vasca 2006, *Averaging of nonsmooth systems using dither*, Automatica 42; Pervozvanski and
Canudas de Wit 2002, *Asymptotic analysis of the dither effect in systems with friction*, Automatica
38; Canudas de Wit, Olsson, Åström, Lischinsky 1995 (LuGre), IEEE TAC 40.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM, WAVEFORMS
from stiction_envs.errors import unknown

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_QUARTER = (np.arange(720) + 0.5) / 720 * np.pi / 2
"""Phases of a quarter period [rad]: |cos| repeats over the others."""


def shapes() -> list[str]:
    """Return the waveforms whose averaged friction is known in closed form."""
    return [name for name, w in WAVEFORMS.items() if w.mean_sign(np.zeros(1)) is not None]


def averaged_coulomb(
    v: ArrayLike, speed_amplitude: ArrayLike, coulomb: ArrayLike, shape: str = DEFAULT_WAVEFORM
) -> Array:
    """Return Coulomb friction averaged over an oscillation of the *speed* [N·m].

    F_c · (share of the time in which v + ṽ > 0, less that in which it is < 0): what counts is the
    amplitude distribution of ṽ, not its frequency, once fast enough (Zames and Shneydor 1976;
    sources.md 4.1). For |v| < V that is

        sine      (2F_c/π) asin(v/V)
        triangle  F_c v/V
        square    0

    and F_c sign v beyond. The error is O(1/f) (Iannelli et al. 2006); a square has flat stretches,
    where that bound fails.

    Args:
        v: slow part of the speed [rad/s].
        speed_amplitude: V, peak of the oscillation [rad/s], ≥ 0; 0 is no oscillation.
        coulomb: F_c [N·m].
        shape: waveform of the oscillation, one of :func:`shapes`.

    Raises:
        StictionError: another shape.
    """
    v, peak = np.asarray(v, float), np.asarray(speed_amplitude, float)
    still = peak == 0
    x = np.where(still, np.sign(v), v / np.where(still, 1.0, peak))
    share = WAVEFORMS[shape].mean_sign(x) if shape in WAVEFORMS else None
    if share is None:
        raise unknown("oscillation", shape, shapes())
    share = np.where(still, np.sign(v), share)
    return np.asarray(np.asarray(coulomb, float) * share, dtype=np.float64)


def impedance(
    frequency: ArrayLike,
    *,
    rotor_inertia: ArrayLike,
    link_inertia: ArrayLike = 0.0,
    joint_stiffness: ArrayLike = np.inf,
    joint_damping: ArrayLike = 0.0,
) -> Complex:
    """Return the joint's mechanical impedance at the rotor, torque over speed [N·m·s/rad].

    The spring's torque is also the link's, and their speeds add up to the rotor's, so that their
    admittances add (two-mass system of `friction.lone_joint`, any textbook of vibration):

        Z(ω) = iωJ_r + 1 / (1/(K/(iω) + D) + 1/(iωJ_l))

    A rigid joint (K = inf) is iω(J_r + J_l).

    Args:
        frequency: f [Hz], > 0.
        rotor_inertia: J_r [kg·m²].
        link_inertia: J_l [kg·m²].
        joint_stiffness: K [N·m/rad]; inf is rigid.
        joint_damping: D [N·m·s/rad].
    """
    iw = 2j * np.pi * np.asarray(frequency, float)
    link = iw * np.asarray(link_inertia, float)
    k = np.asarray(joint_stiffness, float)
    rigid = ~np.isfinite(k)
    spring = np.where(rigid, 0.0, k) / iw + np.asarray(joint_damping, float)
    both = link + spring
    none = both == 0  # neither link nor spring
    behind = np.where(rigid, link, link * spring / np.where(none, 1.0, both))
    return np.asarray(iw * np.asarray(rotor_inertia, float) + behind, dtype=np.complex128)


def speed_amplitude(amplitude: ArrayLike, impedance: ArrayLike, coulomb: ArrayLike = 0.0) -> Array:
    """Return the peak speed V of the rotor under a torque A sin 2πft [rad/s].

    Free: V = A/|Z|, for a rigid joint A/(Jω) (sources.md 4.2). With Coulomb friction of level F,
    whose first harmonic at a sine of speed is 4F/π in phase with it (describing function), the
    torques balance when

        |Z V + 4F/π| = A,

    and there is no such V for A ≤ 4F/π: the joint sticks during most of a period.

    Args:
        amplitude: A [N·m].
        impedance: Z of `impedance` [N·m·s/rad].
        coulomb: F [N·m]; 0 for the free joint.
    """
    z = np.asarray(impedance, complex)
    a, load = np.asarray(amplitude, float), 4 / np.pi * np.asarray(coulomb, float)
    size = np.abs(z) ** 2
    drive = np.maximum(a**2 - load**2, 0.0)
    return np.asarray((np.sqrt((z.real * load) ** 2 + size * drive) - z.real * load) / size)


def lowpass(frequency: ArrayLike, cutoff: ArrayLike, step: float = 1e-3) -> Complex:
    """Return the response of the robot's low-pass y ← y + g(u − y) to a sine [-].

        H(ω) = g / (1 − (1 − g) e^(−iωΔt)),  g = Δt/(Δt + 1/(2πf_c))

    Its magnitude is the gain, its angle the phase [rad] (sources.md 1.8).

    Args:
        frequency: f [Hz].
        cutoff: f_c [Hz]; inf is off.
        step: Δt [s].
    """
    gain = step / (step + 1 / (2 * np.pi * np.asarray(cutoff, float)))
    delay = np.exp(-2j * np.pi * np.asarray(frequency, float) * step)
    return np.asarray(gain / (1 - (1 - gain) * delay), dtype=np.complex128)


def slide(
    inertia: ArrayLike,
    ramp_rate: float,
    distance: ArrayLike,
    *,
    speed: ArrayLike = 0.0,
    excess: ArrayLike = 0.0,
) -> Array:
    """Return by how much the ramp still grows while a freed joint slides to the threshold [N·m].

    From the instant friction can no longer hold, the torque beyond it is r t plus whatever friction
    has dropped by: J dv/dt = e + r t, so that the joint has slid by d after the t of

        r t³/6J + e t²/2J + v t = d,

    and the ramp has grown by r t; without e and v that is r ∛(6Jd/r) (sources.md 3.2: 2-15 % of
    F_s). Viscous friction is left out.

    Args:
        inertia: J, rotor and link [kg·m²]; 0 gives 0.
        ramp_rate: r [N·m/s].
        distance: d [rad], ≥ 0.
        speed: v at that instant [rad/s].
        excess: e, drop of friction from static to kinetic [N·m].
    """
    j, d, v, e = np.broadcast_arrays(
        *(np.asarray(x, float) for x in (inertia, distance, speed, excess))
    )
    low, high = np.zeros(j.shape), np.cbrt(6 * j * d / ramp_rate)
    for _ in range(60):  # the left side rises with t, so halving finds it
        t = (low + high) / 2
        short = ramp_rate * t**3 / 6 + e * t**2 / 2 + j * v * t < j * d
        low, high = np.where(short, t, low), np.where(short, high, t)
    return np.asarray(ramp_rate * high, dtype=np.float64)


def ramp_peak(
    stiction: ArrayLike,
    coulomb: ArrayLike,
    stribeck_velocity: ArrayLike,
    bristle_stiffness: ArrayLike,
    ramp_rate: float,
) -> Array:
    """Return the torque at which a LuGre joint without dither lets go under a ramp [N·m].

    Its bristles must follow the ramp, dz/dt = r/σ0 = v(1 − τ/g(v)), so that it is already creeping
    at v when the ramp is at τ, and friction has already begun to fall:

        τ_peak = max over v of g(v)(1 − r/(σ0 v)),

    F_s for a slow ramp, F_c for a fast one, noticeably less than F_s once r/σ0 is some hundredths
    of v_s (Ruderman 2016 measured the like, sources.md 3.2; derived here).

    Args:
        stiction: F_s [N·m].
        coulomb: F_c [N·m].
        stribeck_velocity: v_s [rad/s].
        bristle_stiffness: σ0 [N·m/rad].
        ramp_rate: r [N·m/s].
    """
    f_s, f_c, v_s, s = np.broadcast_arrays(
        *(
            np.asarray(x, float)[..., None]
            for x in (stiction, coulomb, stribeck_velocity, bristle_stiffness)
        )
    )
    least = ramp_rate / s
    v = least * np.geomspace(1.0, 1e7, 2000)
    level = f_c + (f_s - f_c) * np.exp(-np.square(v / v_s))
    return np.asarray((level * (1 - least / v)).max(axis=-1), dtype=np.float64)


def averaged_breakaway(
    coulomb: ArrayLike,
    speed_amplitude: ArrayLike,
    ramp_rate: float,
    threshold: float,
    inertia: ArrayLike = 0.0,
) -> Array:
    """Return what the Single Joint Experiment would read if averaging were all [N·m].

    Under a ramp τ = r t the averaged friction of a sine, (2F/π) asin(v/V), balances the ramp at the
    slow speed v = V sin(πτ/2F): a stuck joint has become a viscous one. The slow motion's own
    inertia is left out there (it follows within JπV/2F seconds). The reading is the ramp when the
    joint has moved by θ:

        θ = ∫ V sin(π r t/2F) dt = (2FV/πr)(1 − cos(πτ/2F))
        τ = (2F/π) acos(1 − x),   x = π r θ/(2FV)

    For V → ∞ that is 0, as (2F/π)√(2x). At x = 1 the ramp has come to F, where friction is used
    up: for x ≥ 1, and with it for V → 0, the reading is F and the `slide` over what is left of θ.
    (From averaging of friction, sources.md 4.1, and the protocol of thesis 3.2; derived here.)

    Args:
        coulomb: F [N·m].
        speed_amplitude: V [rad/s]; 0 is no dither.
        ramp_rate: r [N·m/s].
        threshold: θ [rad].
        inertia: J of the slide, rotor and link [kg·m²]; 0 leaves it out.
    """
    f, v = np.asarray(coulomb, float), np.asarray(speed_amplitude, float)
    crept = 2 * f * v / (np.pi * ramp_rate)
    x = np.minimum(threshold / np.maximum(crept, 1e-12), 1.0)
    left = np.maximum(threshold - crept, 0.0)
    slid = slide(inertia, ramp_rate, left, speed=v)
    return np.asarray(2 * f / np.pi * np.arccos(1 - x) + slid, dtype=np.float64)


def presliding_gain(
    frequency: ArrayLike,
    *,
    bristle_stiffness: ArrayLike,
    bristle_damping: ArrayLike,
    impedance: ArrayLike,
) -> Array:
    """Return the bristles' torque amplitude over the dither's, for a joint that sticks [-].

    A stuck joint hangs on its bristles, a spring σ0 with damping σ1 (LuGre at |z| ≪ F/σ0, where
    dz/dt = v): X = A/|σ0 + iωσ1 + iωZ|, and σ0X of the dither arrives at the friction,

        σ0 / |σ0 + iωσ1 + iωZ|,

    for a rigid joint σ0/|σ0 − Jω² + iσ1ω| (sources.md 4.3).

    Args:
        frequency: f [Hz].
        bristle_stiffness: σ0 [N·m/rad].
        bristle_damping: σ1, viscous friction added [N·m·s/rad].
        impedance: Z of `impedance` at that frequency [N·m·s/rad].
    """
    w = 2 * np.pi * np.asarray(frequency, float)
    s = np.asarray(bristle_stiffness, float)
    dynamic = s + 1j * w * (np.asarray(bristle_damping, float) + np.asarray(impedance, complex))
    return np.asarray(s / np.abs(dynamic), dtype=np.float64)


def bristle_speed(
    amplitude: ArrayLike, frequency: ArrayLike, gain: ArrayLike, bristle_stiffness: ArrayLike
) -> Array:
    """Return the peak speed ωX of a joint that sticks and is shaken, ωA·gain/σ0 [rad/s].

    Args:
        amplitude: A [N·m].
        frequency: f [Hz].
        gain: of `presliding_gain` [-].
        bristle_stiffness: σ0 [N·m/rad].
    """
    w = 2 * np.pi * np.asarray(frequency, float)
    reach = np.asarray(amplitude, float) * np.asarray(gain, float)
    return np.asarray(w * reach / np.asarray(bristle_stiffness, float), dtype=np.float64)


def shaken_level(
    stiction: ArrayLike,
    coulomb: ArrayLike,
    stribeck_velocity: ArrayLike,
    speed_amplitude: ArrayLike,
) -> Array:
    """Return the level that a shaken LuGre joint has on average [N·m].

    The bristles relax at the rate σ0|v|/g(v); under v = V cos ωt the mean rate is that of

        g̅ = mean|v| / mean(|v|/g(v)),   g(v) = F_c + (F_s − F_c) e^(−(v/v_s)²),

    which is F_s for V ≪ v_s and F_c for V ≫ v_s: shaking takes away what makes static friction
    larger than kinetic, at any frequency, and no more. (Average of LuGre, Canudas de Wit et al.
    1995, over a fast oscillation as in Pervozvanski and Canudas de Wit 2002; derived here.)

    Args:
        stiction: F_s [N·m].
        coulomb: F_c [N·m].
        stribeck_velocity: v_s [rad/s].
        speed_amplitude: V [rad/s]; 0 is F_s.
    """
    f_s, f_c, v_s, peak = np.broadcast_arrays(
        *(
            np.asarray(x, float)[..., None]
            for x in (stiction, coulomb, stribeck_velocity, speed_amplitude)
        )
    )
    shape = np.cos(_QUARTER)
    level = f_c + (f_s - f_c) * np.exp(-np.square(peak * shape / v_s))
    return np.asarray(shape.mean() / (shape / level).mean(axis=-1), dtype=np.float64)


def _creep() -> tuple[Array, Array]:
    """Return x = ∫ u dh and h over u from 0 to 1: see `creep_breakaway`."""
    u = np.sin(np.linspace(0, np.pi / 2, 4001))
    h = np.pi * u / (2 * (np.sqrt(1 - u**2) + u * np.arcsin(u)))
    return np.concatenate([[0.0], np.cumsum((u[1:] + u[:-1]) / 2 * np.diff(h))]), h


def creep_breakaway(
    level: ArrayLike,
    speed_amplitude: ArrayLike,
    ramp_rate: float,
    threshold: float,
    inertia: ArrayLike = 0.0,
    drop: ArrayLike = 0.0,
) -> Array:
    """Return what the experiment would read of a joint whose shaken bristles creep [N·m].

    Averaged over the oscillation, a bristle obeys dz/dt = v̄ − σ0 z mean|v|/g. In balance with
    the ramp, τ = σ0 z, it lets the joint creep at v̄ = V u with

        τ/g = u / mean|u + cos| = πu/(2(√(1 − u²) + u asin u)) = h(u),   0 ≤ u ≤ 1,

    viscous at first, τ = (π/2) g v̄/V, and g at u = 1. The joint has moved by θ when

        θ r/(V g) = ∫ u dh,

    at most 0.37 (at τ = g); beyond, and for V → 0, the reading is g and the `slide` over what is
    left of θ. The g to use is `shaken_level`. An elasto-plastic joint does none of this below its
    elastic limit. (LuGre averaged as in Pervozvanski and Canudas de Wit 2002; derived here.)

    Args:
        level: g [N·m].
        speed_amplitude: V, of `bristle_speed` [rad/s]; 0 is no dither.
        ramp_rate: r [N·m/s].
        threshold: θ [rad].
        inertia: J of the slide, rotor and link [kg·m²]; 0 leaves it out.
        drop: by how much friction falls below g once the joint slides [N·m].
    """
    g, v = np.asarray(level, float), np.asarray(speed_amplitude, float)
    x, h = _creep()
    per_x = g * v / ramp_rate
    reach = np.minimum(threshold / np.maximum(per_x, 1e-12), x[-1])
    left = np.maximum(threshold - per_x * x[-1], 0.0)
    slid = slide(inertia, ramp_rate, left, speed=v, excess=drop)
    # h goes as √x at the start
    held = np.interp(np.sqrt(reach), np.sqrt(x), h)
    return np.asarray(g * held + slid, dtype=np.float64)


def presliding_resonance(bristle_stiffness: ArrayLike, inertia: ArrayLike) -> Array:
    """Return f_p = √(σ0/J)/2π, where a rigid stuck joint resonates [Hz] (sources.md 4.3).

    Args:
        bristle_stiffness: σ0 [N·m/rad].
        inertia: J that hangs on the bristles [kg·m²].
    """
    return np.asarray(np.sqrt(np.asarray(bristle_stiffness, float) / inertia) / (2 * np.pi))


def bristle_breakaway(stiction: ArrayLike, amplitude: ArrayLike, gain: ArrayLike) -> Array:
    """Return the ramp at which ramp and bristle oscillation together reach F_s, F_s − A·gain [N·m].

    The first slip, not yet the 0.15 rad of the experiment: a lower bound for what it reads
    (sources.md 4.3, 4.4). Not below 0.

    Args:
        stiction: F_s [N·m].
        amplitude: A [N·m].
        gain: of `presliding_gain` [-].
    """
    reach = np.asarray(amplitude, float) * np.asarray(gain, float)
    return np.maximum(np.asarray(stiction, float) - reach, 0.0)


def band_breakaway(stiction: ArrayLike, amplitude: ArrayLike) -> Array:
    """Return F_s − A, not below 0 [N·m]: stiction as a band of torque, as in thesis 2.6.

    Args:
        stiction: F_s [N·m].
        amplitude: A [N·m].
    """
    return bristle_breakaway(stiction, amplitude, 1.0)
