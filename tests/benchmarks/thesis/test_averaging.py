"""Theory of dither: limits, known values, and the simulations that must approach it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.thesis.nested_models import averaging as av
from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.hidden.friction_law import LuGre
from tests.hidden.one_joint import simulate_joint


def test_impedance_limits():
    """Stiff or without frequency: one mass; soft or fast: the rotor alone."""
    w = 2 * np.pi * 20.0
    both = {"rotor_inertia": 0.2, "link_inertia": 1.0}
    np.testing.assert_allclose(av.impedance(20.0, **both), 1j * w * 1.2)
    np.testing.assert_allclose(av.impedance(20.0, joint_stiffness=1e9, **both), 1j * w * 1.2, 1e-4)
    np.testing.assert_allclose(av.impedance(20.0, joint_stiffness=1e-3, **both), 1j * w * 0.2, 1e-4)
    slow, fast = av.impedance(np.array([0.01, 1e5]), joint_stiffness=1e4, **both) / (2j * np.pi)
    assert slow == pytest.approx(0.01 * 1.2, rel=1e-4)
    assert fast == pytest.approx(1e5 * 0.2, rel=1e-4)
    # antiresonance: the link on its spring holds the rotor still, up to the spring's damping
    f = np.sqrt(1e4 / 1.0) / (2 * np.pi)
    still = av.impedance(f, joint_stiffness=1e4, joint_damping=0.1, **both)
    assert abs(still) > 1e5


def test_speed_under_friction_balances_the_first_harmonic():
    z = av.impedance(np.array([10.0, 30.0, 60.0]), rotor_inertia=0.2) + 0.4
    v = av.speed_amplitude(2.0, z, 1.0)
    np.testing.assert_allclose(np.abs(z * v + 4 / np.pi), 2.0)
    assert (v < av.speed_amplitude(2.0, z)).all()
    np.testing.assert_array_equal(av.speed_amplitude([1.0, 1.27], z[0], 1.0), 0.0)


def test_lowpass_is_the_table_of_physics_md():
    f = np.array([15, 20, 30, 50, 80, 100, 200])
    h = av.lowpass(f, 100.0)
    np.testing.assert_allclose(
        np.abs(h), [0.982, 0.969, 0.934, 0.844, 0.704, 0.623, 0.386], atol=6e-4
    )
    degrees = np.degrees(np.angle(h))
    np.testing.assert_allclose(degrees, [-8.5, -11, -16, -24.5, -32.6, -35.7, -35.8], atol=0.4)
    np.testing.assert_allclose(av.lowpass(f, np.inf), 1.0)


def test_averaged_breakaway_limits():
    """No oscillation: F. Endless: 0, as (2F/π)√(2x). At x = 1 the two branches meet."""
    assert float(av.averaged_breakaway(0.8, 0.0, 0.07, 0.15)) == pytest.approx(0.8)
    assert float(av.averaged_breakaway(0.8, 1e-9, 0.07, 0.15)) == pytest.approx(0.8)
    x = np.pi * 0.07 * 0.15 / (2 * 0.8 * 1e4)
    found = av.averaged_breakaway(0.8, 1e4, 0.07, 0.15)
    assert found == pytest.approx(2 * 0.8 / np.pi * np.sqrt(2 * x), rel=1e-4)
    meets = np.pi * 0.07 * 0.15 / (2 * 0.8)
    assert av.averaged_breakaway(0.8, meets * (1 + 1e-9), 0.07, 0.15) == pytest.approx(0.8)
    falling = av.averaged_breakaway(0.8, np.geomspace(1e-3, 10, 30), 0.07, 0.15)
    assert (np.diff(falling) <= 0).all()


def test_averaged_breakaway_solves_the_averaged_motion():
    """Law checked: (2F/π) asin(v/V) = r t, integrated to the threshold."""
    f, v, rate, threshold = 0.8, 0.4, 0.07, 0.15
    tau = float(av.averaged_breakaway(f, v, rate, threshold))
    ramp = np.linspace(0, tau, 200_001)
    speed = v * np.sin(np.pi * ramp / (2 * f))
    np.testing.assert_allclose(2 * f / np.pi * np.arcsin(speed / v), ramp, atol=1e-6)
    assert np.trapezoid(speed, ramp / rate) == pytest.approx(threshold, rel=1e-6)


def joints(**changes: Any) -> LoneJoints:
    """Rigid joints, one friction level of 1 N·m, bristles as stiff as 1 ms allows."""
    values: dict[str, Any] = {
        "stiction": 1.0,
        "coulomb_ratio": 1.0,
        "stribeck_velocity": 0.01,
        "bristle_stiffness": 1e4,
        "bristle_damping": 30.0,
        "viscous": 0.0,
        "rotor_inertia": 0.1,
        "joint_stiffness": np.inf,
        "joint_damping": 0.0,
        "link_inertia": 1e-6,
        "amplitude": 0.0,
        "frequency": 20.0,
        "ramp_rate": 0.1,
        "lowpass_hz": np.inf,
        "torque_rate": np.inf,
        "breakaway_ratio": 0.0,
        **changes,
    }
    n = max(np.size(v) for v in values.values())
    return LoneJoints(**{k: np.full(n, v, dtype=float) for k, v in values.items()})


def test_simulation_approaches_averaging_as_the_dither_gets_faster():
    """At equal V the error falls at least as fast as 1/f (Iannelli et al. 2006), to under 4 %.

    A = 5 F, so that the joint slides to and fro, and 20 Hz at most, so that the stroke V/ω stays
    above 30 times the bristles' F/σ0. What is left is the start: a sine of torque from rest has a
    mean speed V, which friction stops within JV/F, after a share of the threshold that goes as J,
    and J as 1/f.
    """
    amplitude, speed, rate, threshold = 5.0, 0.4, 0.1, 0.15
    f = np.array([2.5, 5.0, 10.0, 20.0])
    inertia = amplitude / (2 * np.pi * f * speed)
    found = breakaway(
        joints(amplitude=amplitude, frequency=f, rotor_inertia=inertia, ramp_rate=rate),
        threshold=threshold,
        longest=15.0,
    )
    v = av.speed_amplitude(amplitude, av.impedance(f, rotor_inertia=inertia), 1.0)
    theory = av.averaged_breakaway(1.0, v, rate, threshold)
    np.testing.assert_allclose(theory, theory[0])
    error = np.abs(found / theory - 1)
    assert (error[1:] <= 0.55 * error[:-1]).all()
    assert error[-1] < 0.04


def test_simulation_needs_the_describing_function_near_the_friction_level():
    """At A = 2 F friction takes a fifth of the speed; with it, averaging holds to 5 %."""
    amplitude = np.array([2.0, 3.0, 5.0])
    found = breakaway(joints(amplitude=amplitude), threshold=0.15, longest=15.0)
    z = av.impedance(20.0, rotor_inertia=0.1)
    loaded = av.averaged_breakaway(1.0, av.speed_amplitude(amplitude, z, 1.0), 0.1, 0.15)
    np.testing.assert_allclose(found, loaded, rtol=0.05)
    free = av.averaged_breakaway(1.0, av.speed_amplitude(amplitude, z), 0.1, 0.15)
    assert found[0] / free[0] > 1.1


def test_slide_solves_its_equation_and_has_its_limits():
    inertia, rate, distance = np.array([0.1, 1.0, 3.0]), 0.07, 0.15
    grown = av.slide(inertia, rate, distance, speed=0.02, excess=0.1)
    t = grown / rate
    moved = rate * t**3 / (6 * inertia) + 0.1 * t**2 / (2 * inertia) + 0.02 * t
    np.testing.assert_allclose(moved, distance, rtol=1e-9)
    free = av.slide(inertia, rate, distance)
    np.testing.assert_allclose(free, rate * np.cbrt(6 * inertia * distance / rate))
    assert (grown < free).all()
    assert av.slide(0.0, rate, distance) == 0.0


@pytest.mark.parametrize("rate", [0.02, 1.0])
def test_a_faster_ramp_lets_go_earlier(rate):
    """Law checked: the largest bristle torque under a ramp, r/σ0 up to 0.25 v_s."""
    law = LuGre(
        stiction=1.0,
        coulomb=0.7,
        stribeck_velocity=0.004,
        bristle_stiffness=1000.0,
        bristle_damping=3.0,
    )
    h = 1e-3
    torque = rate * h * np.arange(round(1.2 / rate / h))
    _, z = simulate_joint(law, torque, dt=h, inertia=0.02)
    theory = float(av.ramp_peak(1.0, 0.7, 0.004, 1000.0, rate))
    assert 1000.0 * z.max() == pytest.approx(theory, rel=0.02)


def test_ramp_peak_limits():
    """A slow ramp finds F_s, a fast one F_c."""
    assert av.ramp_peak(1.0, 0.7, 0.004, 1000.0, 1e-6) == pytest.approx(1.0, abs=0.01)
    assert av.ramp_peak(1.0, 0.7, 0.004, 1000.0, 1e3) == pytest.approx(0.7, abs=1e-3)


def test_shaken_level_is_the_mean_rate_of_relaxation():
    """Law checked: mean|v| / mean(|v|/g(v)) over a period of v = V cos ωt, around V = v_s."""
    speeds = np.array([[0.001, 0.002], [0.003, 0.008]])
    v = np.abs(speeds[..., None] * np.cos(2 * np.pi * (np.arange(9973) + 0.25) / 9973))
    level = 0.8 + 0.2 * np.exp(-((v / 0.003) ** 2))
    by_hand = v.mean(axis=-1) / (v / level).mean(axis=-1)
    found = av.shaken_level(1.0, 0.8, 0.003, speeds)
    np.testing.assert_allclose(found, by_hand, rtol=1e-5)
    np.testing.assert_array_equal(found[1, 0], av.shaken_level(1.0, 0.8, 0.003, 0.003))


SHAKEN = {"bristle_stiffness": 1500.0, "ramp_rate": 0.07}


def shaken(amplitude: float, frequency: np.ndarray, inertia: float, **changes: float) -> LoneJoints:
    """Joints that stick on soft bristles, σ1 = 2·0.4·√(σ0 J)."""
    sigma1 = 0.8 * np.sqrt(SHAKEN["bristle_stiffness"] * inertia)
    values = {**SHAKEN, "rotor_inertia": inertia, "bristle_damping": sigma1, **changes}
    return joints(amplitude=amplitude, frequency=frequency, **values)


def shaken_speed(c: LoneJoints) -> np.ndarray:
    """Return ωX of these joints."""
    z = av.impedance(c.frequency, rotor_inertia=c.rotor_inertia)
    gain = av.presliding_gain(
        c.frequency,
        bristle_stiffness=c.bristle_stiffness,
        bristle_damping=c.bristle_damping,
        impedance=z,
    )
    assert (gain * c.amplitude < 0.6 * c.stiction).all()  # it does stick
    return av.bristle_speed(c.amplitude, c.frequency, gain, c.bristle_stiffness)


def test_simulation_creeps_as_averaged_bristles():
    """Law checked: LuGre averaged over the shaking, with its slide, to 3 %."""
    f = np.array([30.0, 30.0, 50.0, 80.0])
    c = shaken(1.0, f, 0.1)
    c.amplitude[0] = 0.0
    found = breakaway(c, threshold=0.15, longest=20.0)
    theory = av.creep_breakaway(1.0, shaken_speed(c), 0.07, 0.15, 0.1)
    np.testing.assert_allclose(found, theory, rtol=0.03)
    assert found[1] < 0.75 * found[0]


def test_creep_limits():
    """Slow: the slope π/2 of the averaged bristles. No shaking: the level."""
    assert av.creep_breakaway(0.8, 0.0, 0.07, 0.15) == pytest.approx(0.8)
    speed = 1e3
    tau = av.creep_breakaway(0.8, speed, 0.07, 0.15)
    # τ = (π/2) g v̄/V under τ = r t: θ = V τ²/(π g r)
    assert tau == pytest.approx(np.sqrt(np.pi * 0.8 * 0.07 * 0.15 / speed), rel=1e-3)
    falling = av.creep_breakaway(0.8, np.geomspace(1e-3, 10, 30), 0.07, 0.15)
    assert (np.diff(falling) <= 1e-12).all()


def test_resonance_of_presliding():
    """sources.md 4.3: σ0 2000 on 0.082 kg·m² at 25 Hz; below gain 1, above (f_p/f)²."""
    f_p = np.sqrt(2000.0 / 0.082) / (2 * np.pi)
    assert f_p == pytest.approx(25, abs=0.2)
    f = f_p * np.array([1e-2, 1.0, 1e2])
    z = av.impedance(f, rotor_inertia=0.082)
    gain = av.presliding_gain(f, bristle_stiffness=2000.0, bristle_damping=5.0, impedance=z)
    # at resonance the damping alone holds against the dither
    expected = [1.0, 2000.0 / (5.0 * 2 * np.pi * f_p), 1e-4]
    np.testing.assert_allclose(gain, expected, rtol=5e-3)


@pytest.mark.parametrize("stiffness", [np.inf, 4000.0])
def test_presliding_gain_is_the_joints_frequency_response(stiffness):
    """Law checked: bristle torque over dither of `friction.law.simulate_joint` at 2 % of F."""
    sigma0, sigma1, rotor, link, damping = 1500.0, 12.0, 0.15, 0.6, 3.0
    f = np.array([4.0, 8.0, 15.0, 30.0, 50.0])
    law = LuGre(
        stiction=np.ones(len(f)),
        coulomb=1.0,
        stribeck_velocity=0.01,
        bristle_stiffness=sigma0,
        bristle_damping=sigma1,
    )
    h, amplitude = 1e-4, 0.02
    t = h * np.arange(round(2.0 / h))
    rigid = np.isinf(stiffness)
    _, z = simulate_joint(
        law,
        amplitude * np.sin(2 * np.pi * f * t[:, None]),
        dt=h,
        inertia=rotor + link if rigid else rotor,
        stiffness=stiffness,
        link_inertia=link,
        damping=damping,
    )
    settled = sigma0 * np.abs(z[round(1.0 / h) :]).max(axis=0) / amplitude
    theory = av.presliding_gain(
        f,
        bristle_stiffness=sigma0,
        bristle_damping=sigma1,
        impedance=av.impedance(
            f,
            rotor_inertia=rotor,
            link_inertia=link,
            joint_stiffness=stiffness,
            joint_damping=damping,
        ),
    )
    # a bristle at z gives way by σ0 z/F, here up to 3 % where it resonates
    np.testing.assert_allclose(settled, theory, rtol=0.04)
