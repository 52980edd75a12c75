"""The numpy LuGre law against its own limit cases and against scipy: sources.md 3.1, 3.2."""

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


def test_stribeck_limits():
    """g is F_s at rest, F_c far above v_s, and between them e⁻¹ of the way at v_s."""
    assert JOINT.level(0.0) == 0.6
    assert JOINT.level(1.0) == pytest.approx(0.5, abs=1e-15)
    assert JOINT.level(0.01) == pytest.approx(0.5 + 0.1 * np.exp(-1))
    assert JOINT.level(-0.01) == JOINT.level(0.01)


@pytest.mark.parametrize("v", [-2.0, 0.003])
def test_bristle_settles_at_steady_sliding(v):
    """At constant speed the bristle ends at g/σ0 and the torque at g sign v + σ2 v."""
    z = JOINT.advance(-np.sign(v) * DISTANCE, v, 50 * DISTANCE / abs(v))
    assert z == pytest.approx(np.sign(v) * JOINT.level(v) / 1000.0, rel=1e-9)
    assert JOINT.torque(z, v) == pytest.approx(JOINT.steady(v), rel=1e-9)
    assert abs(JOINT.bristle_rate(z, v)) < 1e-9 * abs(v)


def test_load_lifts_both_levels_in_the_same_ratio():
    """F_s(L) = F_s + k L, and F_c/F_s stays."""
    loaded = law(load_coefficient=0.02, load=20.0)
    assert loaded.level(0.0) == pytest.approx(0.6 + 0.02 * 20.0)
    assert loaded.level(1.0) / loaded.level(0.0) == pytest.approx(0.5 / 0.6)


@pytest.mark.parametrize(("v", "z0"), [(-0.5, 0.4 * DISTANCE), (0.004, -DISTANCE), (1e-7, 0.0)])
def test_advance_is_exact_at_constant_speed(v, z0):
    dt = 1e-3
    ode = solve_ivp(
        lambda t, z: JOINT.bristle_rate(z, v), (0, dt), [z0], method="Radau", rtol=1e-11, atol=1e-16
    )
    assert JOINT.advance(z0, v, dt) == pytest.approx(ode.y[0, -1], rel=1e-8, abs=1e-14)


def test_presliding_stiffness_is_sigma0():
    """A load far under F_s is carried by a spring σ0, and nearly all of the motion comes back."""
    load = 0.01 * 0.6
    up = np.clip(np.arange(2000) / 1000, 0, 1)
    q, z = simulate_joint(JOINT, load * np.concatenate([up, up[::-1]]), dt=1e-3, inertia=0.1)
    assert load / q[1999] == pytest.approx(1000.0, rel=0.01)
    assert load / z[1999] == pytest.approx(1000.0, rel=1e-6)
    assert abs(q[-1]) < 0.02 * q[1999]


def test_passive_only_when_viscous_exceeds_the_bound():
    """Passivity of LuGre with constant σ1: σ2 > σ1 (F_s − F_c)/F_c (sources.md 3.2)."""
    v = np.concatenate([-np.geomspace(1e-6, 10, 300)[::-1], np.geomspace(1e-6, 10, 300)])[:, None]
    z = np.linspace(-1, 1, 401) * DISTANCE

    def least_lost(friction: LuGre) -> float:
        """Least power τ v − d/dt(σ0 z²/2) [W] over all reachable states."""
        lost = friction.torque(z, v) * v - 1000.0 * z * friction.bristle_rate(z, v)
        return float(lost.min())

    assert least_lost(law(viscous=1.001 * 8.0 * (0.6 - 0.5) / 0.5)) >= 0.0
    assert least_lost(law(viscous=0.0)) < 0.0
