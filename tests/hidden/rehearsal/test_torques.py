"""Each law along a given motion: limit cases, sizes, and what another engine says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, cause_named, register, unregister
from stiction_envs.gap.causes.base import Parameter
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.rehearsal.jobs import LARGE_NOISE, LARGE_SHARE, CauseJob
from stiction_envs.hidden.rehearsal.torques import HiddenTorques, hideable, link_behind_gear
from stiction_envs.hidden.torque_effects import COM, EFFECTS
from stiction_envs.robots import load_arm


@pytest.fixture(scope="module")
def torques(replay) -> HiddenTorques:
    return HiddenTorques(replay=replay)


def job_of(cause: str, *joints: int) -> CauseJob:
    return CauseJob(what=hideable(cause_named(cause)), joints=joints)


def torque(torques: HiddenTorques, name: str, *size: float) -> np.ndarray:
    return torques.hidden(job_of(name, 0, 1), np.array(size))[0]


@pytest.mark.parametrize("name", [c.name for c in CAUSES if c.name in EFFECTS])
def test_no_size_has_no_torque_and_more_has_more(torques, name):
    effect, size, rms = EFFECTS[name], np.zeros(2), []
    joints = [1] if name == "joint_elasticity" else [0, 1]
    for factor in (1e-6, 1.0, 2.0):
        size[joints] = factor * effect.start
        rms.append(np.sqrt(np.mean(np.square(torque(torques, name, *size)), axis=0)))
    assert np.all(rms[0] < 1e-3 * rms[1] + 1e-9)
    seen = rms[1] > 1e-9  # the first axis is vertical
    assert seen.any()
    assert np.all(rms[2][seen] > 1.1 * rms[1][seen])


def test_friction_and_its_refinements_are_those_of_the_steady_law(torques, replay):
    """In fast sliding it is the level; Stribeck friction is gone, an asymmetry is constant."""
    v, level, load = replay.data.dq, replay.friction, np.abs(replay.data.rigid)
    fast = np.abs(v) > 0.2
    dry = torque(torques, "coulomb_friction", 0.3, 0.7)
    np.testing.assert_allclose(dry[fast], (np.sign(v) * [0.3, 0.7])[fast], rtol=1e-6)
    assert np.abs(torque(torques, "stribeck_friction", 0.4, 0.4)[fast]).max() < 1e-6
    half = torque(torques, "direction_asymmetry", 0.2, 0.2)
    np.testing.assert_allclose(half[fast], (0.2 * level + 0 * v)[fast], rtol=1e-6)
    grown = torque(torques, "load_dependent_friction", 0.05, 0.05)
    near = np.abs(grown - 0.05 * load * np.sign(v))[fast]
    assert near.max() < 0.02 * np.abs(grown).max()  # of the load of a row before
    since = replay.data.recording.since_session[:, None]
    drift = torque(torques, "warm_up_drift", 0.3, 0.3)
    expected = 0.3 * level * since / since.max() * np.sign(v)
    np.testing.assert_allclose(drift[fast], expected[fast], atol=1e-3)


def test_a_payload_and_a_tilt_are_those_of_the_arm(torques, replay, two_xml):
    """`load_arm` puts them into the MJCF, and pinocchio says what they weigh."""
    data = replay.data
    motion = data.q, data.dq, data.ddq
    own = load_arm(two_xml, payload=(0.4, *COM)).pinocchio()
    np.testing.assert_allclose(
        torque(torques, "payload", 0.4, 0.4), inverse_dynamics(own, *motion) - data.rigid, atol=1e-9
    )
    roll = pitch = 0.05 / np.sqrt(2)  # of these small angles the order hardly counts
    lean = [load_arm(two_xml, tilt=(a * roll, b * pitch)) for a in (-1, 1) for b in (-1, 1)]
    found = torque(torques, "base_tilt", 0.05, 0.05)
    off = [inverse_dynamics(x.pinocchio(), *motion) - data.rigid - found for x in lean]
    assert min(np.abs(x).max() for x in off) < 0.03 * np.abs(found).max()


def test_a_delay_shifts_the_torque(torques, replay):
    rows, late = replay.data.nominal, torque(torques, "actuator_delay", 0.01, 0.01)
    np.testing.assert_allclose((rows + late)[:-3], rows[2:-1], atol=1e-9)  # two rows of 5 ms


@pytest.mark.parametrize("side", [0.5, -0.5])
def test_a_link_behind_a_gear_rests_on_it(replay, side):
    """The static limit: load over stiffness."""
    t = np.arange(2000) * replay.data.dt
    q = np.zeros((len(t), 2))
    q[:, 1] = side + 1e-3 * np.sin(2 * np.pi * 0.1 * t)  # where gravity loads it to one side
    old = replay.data.recording
    kept = {
        k: getattr(old, k)[: len(t)] for k in ("t", "since_log", "since_session", "block", "log")
    }
    slow = {"q": q, "dq": np.gradient(q, t, axis=0), "ddq": 0 * q, "tau": q, "reversal_path": q}
    recording = replace(old, **slow, segment=np.zeros(len(t), int), **kept)
    data = replace(replay.data, recording=recording, nominal=recording.rigid, rigid=recording.rigid)
    load = data.rigid[:, 1]
    assert np.abs(load).min() > 0.5
    x, v = link_behind_gear(data, 1, 500.0)
    np.testing.assert_allclose(x, -load / 500, rtol=0.02)
    assert np.abs(v).max() < 1e-3


@pytest.mark.parametrize(
    ("cause", "joints"),
    [("presliding_hysteresis", (0, 1)), ("payload", (0, 1)), ("joint_elasticity", (1,))],
)
def test_sizes_are_those_of_torques(torques, replay, cause, joints):
    """From the noise to what nobody overlooks, or to the largest size there is."""
    job = job_of(cause, *joints)
    small, middle, large = torques.sizes(job)
    whole = np.sqrt(np.mean(np.square(replay.data.nominal), axis=0))
    for size, target in (
        (small, replay.noise),
        (large, np.maximum(LARGE_NOISE * replay.noise, LARGE_SHARE * whole)),
    ):
        in_band = replay.in_band(torques.hidden(job, size)[0])
        ratio = (np.sqrt(np.mean(np.square(in_band), axis=0)) / target)[list(joints)]
        if job.what.arm_wide or job.what.coupled:
            ratio = ratio.max()
        at_the_end = np.all(size[list(joints)] == EFFECTS[cause].largest)
        assert at_the_end or np.allclose(ratio, 1.0, rtol=0.05)
    np.testing.assert_allclose(np.square(middle), small * large)


def test_a_linear_cause_of_another_package_is_hidden_by_its_own_columns(torques):
    class Bias(TorqueOffset):
        name = "bias"
        parameters = (Parameter("bias_nm", "N·m"),)

    register(Bias())
    try:
        job = job_of("bias", 1)
        found, shown = torques.hidden(job, np.array([0.0, 2.0]))
        np.testing.assert_array_equal(found[5], [0.0, 2.0])
        assert (job.what.parameter, job.what.unit, shown) == ("bias_nm", "N·m", {"2": 2.0})
    finally:
        unregister("bias")
