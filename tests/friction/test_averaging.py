"""Breakaway of a rigid joint under dither, against averaging theory and the limits of frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stiction_envs.friction.lone_joint import breakaway
from tests.friction.test_lone_joint import joints

RATE, THRESHOLD = 0.1, 0.15
"""Of the ramp [N·m/s]; what counts as moved [rad]."""


def dry(threshold: float = THRESHOLD, **changes: Any) -> np.ndarray:
    """Return breakaway torques of joints with 1 N·m of dry friction, stiff bristles."""
    values: dict[str, Any] = {
        "stiction": 1.0,
        "coulomb_ratio": 1.0,
        "viscous": 0.0,
        "bristle_stiffness": 1e4,
        "rotor_inertia": 0.1,
        "link_inertia": 1e-6,
        "ramp_rate": RATE,
        "lowpass_hz": np.inf,
        **changes,
    }
    return breakaway(joints(**values), threshold=threshold, longest=40.0)


def test_fast_dither_takes_friction_away_as_averaging_says():
    """Law checked: a sine of speed V leaves (2F/π) asin(v/V) of dry friction F (Zames 1976).

    A ramp r t moves such a joint by θ at τ = (2F/π) acos(1 − πrθ/2FV). With A sin ωt on an inertia
    J the first harmonics balance, |iωJV + 4F/π| = A. The stroke V/ω is above 10 times the bristles'
    F/σ0, and A above F, so that the joint slides to and fro.
    """
    amplitude, frequency = np.array([2.0, 3.0, 5.0]), 20.0
    speed = np.sqrt(amplitude**2 - (4 / np.pi) ** 2) / (2 * np.pi * frequency * 0.1)
    assert (speed / (2 * np.pi * frequency) > 9.5e-4).all()
    theory = 2 / np.pi * np.arccos(1 - np.pi * RATE * THRESHOLD / (2 * speed))
    found = dry(amplitude=amplitude, frequency=frequency)
    np.testing.assert_allclose(found, theory, rtol=0.05)


def test_slow_dither_adds_to_the_ramp_and_fast_dither_is_lost_to_inertia():
    """Law checked: breakaway goes to F − A for f → 0, to that without dither for f → ∞."""
    without, fast = dry(amplitude=np.array([0.0, 0.4]), frequency=200.0)
    assert fast == pytest.approx(without, rel=0.01)
    # the first slip: many slips of a slow dither, each short, need longer to reach 0.15 rad
    slow = dry(5e-3, amplitude=0.4, frequency=np.array([0.5, 1.0]), ramp_rate=0.02)
    np.testing.assert_allclose(slow, 1.0 - 0.4, rtol=0.1)
