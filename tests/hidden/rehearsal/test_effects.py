"""Each law along a given motion: limit cases, and what another engine says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.rehearsal.effects import (
    COM,
    FLANK,
    REPLAYED,
    dry_friction,
    link_behind_gear,
    swing,
)
from stiction_envs.robots import load_arm


def torque(replay, name: str, *size: float) -> np.ndarray:
    return REPLAYED[name].torque(replay, np.array(size))


def with_rigid(replay, q, dq, ddq):
    """The replay of another motion in its first rows, against the rigid arm."""
    old, rows = replay.data.recording, slice(0, len(q))
    kept = {k: getattr(old, k)[rows] for k in ("t", "since_log", "since_session", "block", "log")}
    recording = replace(
        old, q=q, dq=dq, ddq=ddq, tau=q, reversal_path=q, segment=np.zeros(len(q), int), **kept
    )
    data = replace(replay.data, recording=recording, nominal=recording.rigid, rigid=recording.rigid)
    return replace(replay, data=data)


def test_every_cause_has_a_law():
    assert {c.name for c in CAUSES} <= REPLAYED.keys()


@pytest.mark.parametrize("name", [c.name for c in CAUSES])
def test_no_size_has_no_torque_and_more_has_more(replay, name):
    start = REPLAYED[name].start
    joints = [1] if name in ("backlash", "joint_elasticity") else [0, 1]
    size = np.zeros(2)
    rms = []
    for factor in (1e-6, 1.0, 2.0):
        size[joints] = factor * start
        rms.append(np.sqrt(np.mean(np.square(REPLAYED[name].torque(replay, size)), axis=0)))
    if not REPLAYED[name].comes_with:
        assert np.all(rms[0] < 1e-3 * rms[1] + 1e-9)
    seen = rms[1] > 1e-9  # the first axis is vertical
    assert seen.any()
    assert np.all(rms[2][seen] > 1.1 * rms[1][seen])


def test_dry_friction_follows_the_motion(replay):
    """Far from reversals it is the level, against the motion."""
    out = dry_friction(replay, np.array([0.3, 0.7]))
    fast = np.abs(replay.data.dq) > 0.2
    expected = np.sign(replay.data.dq) * [0.3, 0.7]
    np.testing.assert_allclose(out[fast], expected[fast], rtol=1e-6)


def test_refinements_of_friction_are_those_of_the_steady_law(replay):
    """In fast sliding Stribeck friction is gone, an asymmetry is constant, load counts."""
    v, level, load = replay.data.dq, replay.friction, np.abs(replay.data.rigid)
    fast = np.abs(v) > 0.2
    assert np.abs(torque(replay, "stribeck_friction", 0.4, 0.4)[fast]).max() < 1e-6
    half = torque(replay, "direction_asymmetry", 0.2, 0.2)
    np.testing.assert_allclose(half[fast], (0.2 * level + 0 * v)[fast], rtol=1e-6)
    grown = torque(replay, "load_dependent_friction", 0.05, 0.05)
    near = np.abs(grown - 0.05 * load * np.sign(v))[fast]
    assert near.max() < 0.02 * np.abs(grown).max()  # of the load of a row before
    since = replay.data.recording.since_session[:, None]
    drift = torque(replay, "warm_up_drift", 0.3, 0.3)
    expected = 0.3 * level * since / since.max() * np.sign(v)
    np.testing.assert_allclose(drift[fast], expected[fast], atol=1e-3)


def test_a_payload_and_a_tilt_are_those_of_the_arm(replay, two_xml):
    """`load_arm` puts them into the MJCF."""
    data = replay.data
    motion = data.q, data.dq, data.ddq
    own = load_arm(two_xml, payload=(0.4, *COM)).pinocchio()
    np.testing.assert_allclose(
        torque(replay, "payload", 0.4, 0.4), inverse_dynamics(own, *motion) - data.rigid, atol=1e-9
    )
    roll = pitch = 0.05 / np.sqrt(2)  # of these small angles the order hardly counts
    lean = [load_arm(two_xml, tilt=(a * roll, b * pitch)) for a in (-1, 1) for b in (-1, 1)]
    found = torque(replay, "base_tilt", 0.05, 0.05)
    off = [inverse_dynamics(x.pinocchio(), *motion) - data.rigid - found for x in lean]
    assert min(np.abs(x).max() for x in off) < 0.03 * np.abs(found).max()


def test_a_delay_shifts_the_torque(replay):
    rows, late = replay.data.nominal, torque(replay, "actuator_delay", 0.01, 0.01)
    np.testing.assert_allclose((rows + late)[:-3], rows[2:-1], atol=1e-9)  # two rows of 5 ms


def slowly(replay, load_side: float):
    """A motion of the second joint about an angle where gravity loads it to one side."""
    t = np.arange(2000) * replay.data.dt
    q = np.zeros((len(t), 2))
    q[:, 1] = load_side + 1e-3 * np.sin(2 * np.pi * 0.1 * t)
    return with_rigid(replay, q, np.gradient(q, t, axis=0), np.zeros_like(q))


@pytest.mark.parametrize("side", [0.5, -0.5])
def test_a_link_behind_a_gear_rests_on_it(replay, side):
    """The static limit: half the gap to the side of the load, and load over stiffness."""
    slow = slowly(replay, side)
    load = slow.data.rigid[:, 1]
    assert np.abs(load).min() > 0.5
    x, v = link_behind_gear(slow, 1, 0.01, FLANK, 0.2)
    np.testing.assert_allclose(x, -0.005 * np.sign(load) - load / FLANK, atol=2e-5)
    assert np.abs(v).max() < 1e-3
    x, _ = link_behind_gear(slow, 1, 0.0, 500.0, 0.2)
    np.testing.assert_allclose(x, -load / 500, rtol=0.02)


def test_a_soft_gear_rings_at_its_frequency():
    """After a step of the load it swings with √(K/M), about the new rest."""
    mass, stiffness, dt = 0.1, 0.1 * (2 * np.pi * 5.0) ** 2, 1e-3
    load = np.where(np.arange(2000) < 100, 0.0, 1.0)
    out = np.zeros((2000, 2))
    swing(load, 0 * load, mass + 0 * load, 0.0, stiffness, 0.01, dt, 10, out)
    x = out[100:, 0] + 1.0 / stiffness
    crossings = np.flatnonzero(np.diff(np.sign(x)) > 0)
    assert np.diff(crossings).mean() * dt == pytest.approx(0.2, rel=0.01)
    assert np.abs(x[:200]).max() == pytest.approx(1.0 / stiffness, rel=0.02)
