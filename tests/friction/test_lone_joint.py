"""The lone joint against the reference law, its own limits, and closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.friction.parameters import bristle_damping
from stiction_envs.hidden.friction_law import LuGre
from tests.hidden.one_joint import simulate_joint

THRESHOLD = 0.15
"""Angle from which a joint counts as moved [rad]."""
DRY = {
    "coulomb_ratio": 1.0,
    "viscous": 0.0,
    "bristle_stiffness": 1e4,
    "link_inertia": 1e-6,
    "lowpass_hz": np.inf,
}
"""A joint of dry friction on stiff bristles that has nearly no link."""


def joints(**changes: Any) -> LoneJoints:
    """Joints of 0.6 N·m on bristles of 1000 N·m/rad; arguments broadcast."""
    values = {
        "stiction": 0.6,
        "coulomb_ratio": 0.85,
        "stribeck_velocity": 0.01,
        "bristle_stiffness": 1000.0,
        "viscous": 0.15,
        "rotor_inertia": 0.1,
        "joint_stiffness": np.inf,
        "joint_damping": 0.0,
        "link_inertia": 0.05,
        "amplitude": 0.0,
        "frequency": 15.0,
        "ramp_rate": 0.5,
        "lowpass_hz": 100.0,
        "torque_rate": np.inf,
        **changes,
    }
    n = max(np.size(v) for v in values.values())
    columns = {k: np.full(n, v, dtype=float) for k, v in values.items()}
    carried = columns["rotor_inertia"] + np.where(
        np.isfinite(columns["joint_stiffness"]), 0.0, columns["link_inertia"]
    )
    damping = bristle_damping(columns["bristle_stiffness"], 0.4 * np.ones(n), carried, 1e-3)
    columns.setdefault("bristle_damping", damping)
    return LoneJoints(**columns)


def reference(c: LoneJoints, hold: int) -> np.ndarray:
    """Return the same torques from `simulate_joint`."""
    h = 1e-3
    held = np.arange(5000) // hold * hold * h
    rate = c.ramp_rate[0]
    command = rate * held[:, None] + c.amplitude * np.sin(2 * np.pi * c.frequency * held[:, None])
    gain = h / (h + 1 / (2 * np.pi * c.lowpass_hz[0]))
    filtered = lfilter([gain], [1.0, gain - 1.0], command, axis=0)
    rigid = bool(np.isinf(c.joint_stiffness[0]))
    law = LuGre(
        stiction=c.stiction,
        coulomb=c.stiction * c.coulomb_ratio,
        stribeck_velocity=c.stribeck_velocity,
        bristle_stiffness=c.bristle_stiffness,
        bristle_damping=c.bristle_damping,
        viscous=c.viscous,
    )
    q, _ = simulate_joint(
        law,
        filtered,
        dt=h,
        inertia=c.rotor_inertia + (c.link_inertia if rigid else 0.0),
        stiffness=float(c.joint_stiffness[0]),
        link_inertia=c.link_inertia,
        damping=float(c.joint_damping[0]),
    )
    return rate * held[(q >= THRESHOLD).argmax(axis=0)]


@pytest.mark.parametrize(
    ("stiffness", "link", "hold"),
    [(np.inf, 0.05, 1), (1e4, 1.0, 1), (50.0, 1.0, 1), (np.inf, 0.05, 5)],
)
def test_the_lone_joint_agrees_with_the_reference(stiffness, link, hold):
    """To the step in which it breaks away, with and without dither."""
    c = joints(
        amplitude=np.array([0.0, 0.6]),
        joint_stiffness=stiffness,
        joint_damping=3.0,
        link_inertia=link,
    )
    found = breakaway(c, threshold=THRESHOLD, longest=5.0, hold=hold)
    np.testing.assert_allclose(found, reference(c, hold), rtol=1e-12)


def test_without_dither_it_reads_friction_and_the_slide():
    """Law checked: one level F, no viscous friction: θ = r t³/6J after F, so τ = F + r(6Jθ/r)^⅓."""
    inertia, rate = np.array([0.05, 0.2, 1.0]), 0.07
    c = joints(**DRY, stiction=0.8, rotor_inertia=inertia, ramp_rate=rate)
    slide = rate * np.cbrt(6 * inertia * THRESHOLD / rate)
    found = breakaway(c, threshold=THRESHOLD, longest=20.0)
    np.testing.assert_allclose(found, 0.8 + slide, rtol=0.005)


def test_torque_rate_limit_takes_dither_away_only_where_it_is_reached():
    """1.5 N·m at 50 Hz changes by 471 N·m/s at most."""
    c = joints(amplitude=1.5, frequency=50.0, torque_rate=np.array([np.inf, 480.0, 200.0]))
    full, reached, limited = breakaway(c, threshold=THRESHOLD, longest=5.0)
    assert reached == full
    assert full < limited


def test_fast_dither_takes_friction_away_as_averaging_says():
    """Law checked: a sine of speed V leaves (2F/π) asin(v/V) of dry friction F (Zames 1976).

    A ramp r t moves such a joint by θ at τ = (2F/π) acos(1 − πrθ/2FV). With A sin ωt on an inertia
    J the first harmonics balance, |iωJV + 4F/π| = A. The stroke V/ω is above 10 times the bristles'
    F/σ0, and A above F, so that the joint slides to and fro.
    """
    amplitude, frequency, rate = np.array([2.0, 3.0, 5.0]), 20.0, 0.1
    speed = np.sqrt(amplitude**2 - (4 / np.pi) ** 2) / (2 * np.pi * frequency * 0.1)
    assert (speed / (2 * np.pi * frequency) > 9.5e-4).all()
    theory = 2 / np.pi * np.arccos(1 - np.pi * rate * THRESHOLD / (2 * speed))
    c = joints(**DRY, stiction=1.0, amplitude=amplitude, frequency=frequency, ramp_rate=rate)
    found = breakaway(c, threshold=THRESHOLD, longest=40.0)
    np.testing.assert_allclose(found, theory, rtol=0.05)
