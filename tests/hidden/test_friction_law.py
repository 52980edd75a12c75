"""The numpy LuGre law against its own limit cases and against scipy: sources.md 3.1, 3.2."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stiction_envs.hidden.friction_law import LuGre
from tests.hidden.one_joint import simulate_joint

JOINT = LuGre(
    stiction=0.6,
    coulomb=0.5,
    stribeck_velocity=0.01,
    bristle_stiffness=1000.0,
    bristle_damping=8.0,
    viscous=0.2,
)
DISTANCE = 0.6 / 1000.0  # F_s / σ0 [rad]


def law(**changes: object) -> LuGre:
    return dataclasses.replace(JOINT, **changes)  # type: ignore[arg-type]


# ---- steady sliding ------------------------------------------------------------------------


def test_stribeck_limits():
    """g is F_s at rest, F_c far above v_s, and between them e⁻¹ of the way at v_s."""
    assert JOINT.level(0.0) == 0.6
    assert JOINT.level(1.0) == pytest.approx(0.5, abs=1e-15)
    assert JOINT.level(0.01) == pytest.approx(0.5 + 0.1 * np.exp(-1))
    assert JOINT.level(-0.01) == JOINT.level(0.01)


@pytest.mark.parametrize("v", [-2.0, -0.02, -0.003, 0.003, 0.02, 2.0])
def test_bristle_settles_at_steady_sliding(v):
    """At constant speed the bristle ends at g/σ0 and the torque at g sign v + σ2 v."""
    z = JOINT.advance(-np.sign(v) * DISTANCE, v, 50 * DISTANCE / abs(v))
    assert z == pytest.approx(np.sign(v) * JOINT.level(v) / 1000.0, rel=1e-9)
    assert JOINT.torque(z, v) == pytest.approx(JOINT.steady(v), rel=1e-9)
    assert abs(JOINT.bristle_rate(z, v)) < 1e-9 * abs(v)


def test_odd_in_velocity():
    v = np.linspace(0.0, 1.0, 21)
    np.testing.assert_array_equal(JOINT.steady(-v), -JOINT.steady(v))


def test_asymmetry_scales_only_the_other_direction():
    lame = law(asymmetry=1.3)
    v = np.array([0.001, 0.01, 0.5])
    np.testing.assert_array_equal(lame.level(v), JOINT.level(v))
    np.testing.assert_allclose(lame.level(-v), 1.3 * JOINT.level(v), rtol=1e-15)


def test_load_lifts_both_levels_in_the_same_ratio():
    """F_s(L) = F_s + k L, and F_c/F_s stays."""
    loaded = law(load_coefficient=0.02, load=20.0)
    assert loaded.level(0.0) == pytest.approx(0.6 + 0.02 * 20.0)
    assert loaded.level(1.0) / loaded.level(0.0) == pytest.approx(0.5 / 0.6)


def test_laws_broadcast():
    """Many joints at once give what each gives alone."""
    levels = np.array([0.6, 1.0, 2.0])
    many = law(stiction=levels, coulomb=0.8 * levels)
    for k, f_s in enumerate(levels):
        one = law(stiction=f_s, coulomb=0.8 * f_s)
        assert many.torque(1e-4, 0.003)[k] == one.torque(1e-4, 0.003)


# ---- the bristle equation ------------------------------------------------------------------


@pytest.mark.parametrize("v", [-0.5, -0.004, 0.0, 1e-7, 0.004, 0.5])
@pytest.mark.parametrize("z0", [-DISTANCE, 0.0, 0.4 * DISTANCE])
def test_advance_is_exact_at_constant_speed(v, z0):
    dt = 1e-3
    ode = solve_ivp(
        lambda t, z: JOINT.bristle_rate(z, v), (0, dt), [z0], method="Radau", rtol=1e-11, atol=1e-16
    )
    assert JOINT.advance(z0, v, dt) == pytest.approx(ode.y[0, -1], rel=1e-8, abs=1e-14)


def test_varying_speed_converges_to_the_ode():
    """With v held over each step the error against a fine ODE shrinks in proportion to the step."""

    def v(t):
        return 0.02 * np.sin(2 * np.pi * 15 * t)

    end = 0.2
    ode = solve_ivp(
        lambda t, z: JOINT.bristle_rate(z, v(t)), (0, end), [0.0], rtol=1e-10, atol=1e-15,
        max_step=1e-4,
    )  # fmt: skip
    errors = []
    for dt in (1e-3, 2.5e-4, 5e-5):
        z = 0.0
        for k in range(round(end / dt)):
            z = JOINT.advance(z, v(k * dt), dt)
        errors.append(abs(z - ode.y[0, -1]) / DISTANCE)
    assert errors[0] < 0.05
    assert errors[1] < 0.4 * errors[0]
    assert errors[2] < 0.3 * errors[1]


# ---- presliding, hysteresis, breakaway -----------------------------------------------------


def test_presliding_stiffness_is_sigma0():
    """A load far under F_s is carried by a spring σ0, and nearly all of the motion comes back."""
    load = 0.01 * 0.6
    up = np.clip(np.arange(2000) / 1000, 0, 1)
    q, z = simulate_joint(JOINT, load * np.concatenate([up, up[::-1]]), dt=1e-3, inertia=0.1)
    assert load / q[1999] == pytest.approx(1000.0, rel=0.01)
    assert load / z[1999] == pytest.approx(1000.0, rel=1e-6)
    assert abs(q[-1]) < 0.02 * q[1999]


def test_standing_load_deflects_by_the_logarithm():
    """A slow load u bends the bristle by u/σ0, but moves the joint by −ln(1 − u/F_s) F_s/σ0."""
    u = 0.9 * 0.6
    rise = np.clip(np.arange(30_000) / 20_000, 0, 1)
    q, z = simulate_joint(law(coulomb=0.6), u * rise, dt=1e-3, inertia=0.1)
    assert z[-1] == pytest.approx(u / 1000.0, rel=1e-6)
    assert q[-1] == pytest.approx(-np.log(1 - 0.9) * DISTANCE, rel=0.01)
    assert q[-1] == q[-2000]


def test_hysteresis_loop_closes_and_costs_energy():
    """Under a sine load below F_s the path in the torque-angle plane is a closed loop."""
    period, dt = 1000, 1e-3
    u = 0.5 * 0.6 * np.sin(2 * np.pi * np.arange(40 * period) / period)
    q, _ = simulate_joint(JOINT, u, dt=dt, inertia=0.1)
    last, before = q[-period:], q[-2 * period : -period]
    width = last.max() - last.min()
    assert np.abs(last - before).max() < 1e-6 * width
    area = np.sum(0.5 * (u[-period:] + np.roll(u[-period:], 1)) * (last - np.roll(last, 1)))
    assert 0.02 < area / (width * 0.6) < 1.0
    # amplitude of the slow loop lies between bristle only and the loop of a fully sliding joint
    assert 0.5 * DISTANCE < width / 2 < 2 * DISTANCE


def peak_torque(rates: np.ndarray, inertia: float) -> np.ndarray:
    """Largest bristle torque of ramps [N·m]; without σ2, and σ1 so small that it hardly shows."""
    light = law(viscous=0.0, bristle_damping=3.0)
    t = np.arange(round(0.8 / rates.min() / 1e-3))[:, None] * 1e-3
    # a joint that has gone is not accelerated further
    ramps = np.minimum(rates * t, 0.8)
    _, z = simulate_joint(light, ramps, dt=1e-3, inertia=np.full(len(rates), inertia))
    return 1000.0 * z.max(axis=0)


def test_breakaway_falls_with_the_ramp_rate_from_fs_to_fc():
    """Slow ramps find F_s, fast ones F_c: creep r/σ0 against v_s (sources.md 3.2)."""
    peak = peak_torque(np.array([0.02, 0.06, 0.2, 0.6, 20.0]), 0.02)
    assert np.all(np.diff(peak) < 0)
    assert 0.975 * 0.6 < peak[0] < 0.6
    assert 0.5 <= peak[-1] < 1.01 * 0.5


def test_breakaway_of_a_light_joint_is_that_of_the_massless_one():
    """Without inertia σ0 ż = r, so v (1 − σ0 z/g) = r/σ0: the fold is max over v of (1 − r/σ0v) g.

    A joint with inertia lags behind the fold; the gap shrinks with the inertia.
    """
    rates = np.array([0.05, 0.2, 1.0])
    v = np.geomspace(rates / 1000.0, 1.0, 20_000)[1:]
    fold = ((1 - rates / 1000.0 / v) * JOINT.level(v)).max(axis=0)
    heavy, light = (peak_torque(rates, j) / fold - 1 for j in (0.04, 0.005))
    assert np.all(heavy > light)
    assert np.all(light > 0)
    assert np.all(light < 0.01)


# ---- energy --------------------------------------------------------------------------------


def dissipation(friction: LuGre) -> np.ndarray:
    """Power that is lost, τ v − d/dt(σ0 z²/2) [W], over all reachable states."""
    v = np.concatenate([-np.geomspace(1e-6, 10, 300)[::-1], np.geomspace(1e-6, 10, 300)])[:, None]
    z = np.linspace(-1, 1, 401) * DISTANCE
    return friction.torque(z, v) * v - 1000.0 * z * friction.bristle_rate(z, v)


def test_passive_when_viscous_exceeds_the_bound():
    """Passivity of LuGre with constant σ1: σ2 > σ1 (F_s − F_c)/F_c (sources.md 3.2)."""
    bound = 8.0 * (0.6 - 0.5) / 0.5
    assert dissipation(law(viscous=1.001 * bound)).min() >= 0.0


def test_not_passive_without_viscous_part():
    """The check above can fail: without σ2 there are states in which friction drives the joint."""
    assert dissipation(law(viscous=0.0)).min() < 0.0


def test_closed_cycles_cost_work():
    """Whatever the closed motion, friction takes work on a cycle that closes."""
    rng = np.random.default_rng(3)
    t = np.arange(4000) * 2.5e-4  # one period of 1 s
    for _try in range(5):
        a, phase = rng.normal(size=5) * 0.002, rng.uniform(0, 6, 5)
        order = np.arange(1, 6)
        wave = 2 * np.pi * order * t[:, None] + phase
        v = (2 * np.pi * order * a * np.cos(wave)).sum(axis=1)
        z, work = 0.0, 0.0
        for _ in range(3):
            work = 0.0
            for speed in v:
                work += JOINT.torque(z, speed) * speed * 2.5e-4
                z = float(JOINT.advance(z, speed, 2.5e-4))
        assert work > 0.0


# ---- the reference simulation --------------------------------------------------------------


def test_free_joint_without_friction_accelerates():
    """With F → 0 the joint is τ/J; q after t is τ t²/2J."""
    smooth = law(stiction=1e-9, coulomb=1e-9, viscous=0.0)
    q, _ = simulate_joint(smooth, np.full(1000, 0.5), dt=1e-3, inertia=0.2)
    assert q[-1] == pytest.approx(0.5 * 1.0**2 / 2 / 0.2, rel=2e-3)


def test_reference_converges_with_its_step():
    """At 0.05 ms the reference lies within 0.1 % of half the step."""
    ends = []
    for dt in (1e-4, 5e-5, 2.5e-5):
        t = np.arange(round(0.8 / dt)) * dt
        q, _ = simulate_joint(JOINT, 0.7 * np.minimum(t / 0.2, 1.0), dt=dt, inertia=0.1)
        ends.append(q[-1])
    assert abs(ends[1] - ends[2]) < 1e-3 * ends[2]
    assert abs(ends[1] - ends[2]) < 0.7 * abs(ends[0] - ends[1])


def test_spring_limits():
    """A very stiff spring is a rigid joint of both inertias; momentum is conserved across it."""
    u = np.concatenate([np.full(500, 2.0), np.zeros(500)])
    kwargs = {"dt": 5e-5, "link_inertia": 0.3}
    elastic, _ = simulate_joint(JOINT, u, inertia=0.1, stiffness=1e6, damping=50.0, **kwargs)
    rigid, _ = simulate_joint(JOINT, u, inertia=0.4, **kwargs)
    assert elastic[-1] == pytest.approx(rigid[-1], rel=1e-3)
    # without friction rotor and link together follow τ/(J_r + J_l)
    smooth = law(stiction=1e-9, coulomb=1e-9, viscous=0.0)
    q, _ = simulate_joint(
        smooth, np.full(20_000, 1.0), inertia=0.1, stiffness=2000.0, damping=10.0, **kwargs
    )
    assert q[-1] == pytest.approx(1.0 / 2 / 0.4, rel=0.01)
