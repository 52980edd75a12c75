"""Each law along a given motion: limit cases, sizes, and what another engine says."""

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, cause_named, register, unregister
from stiction_envs.gap.causes.base import Parameter
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.rehearsal.jobs import CauseJob, surrogate
from stiction_envs.hidden.rehearsal.rehearse import jobs_of, measure
from stiction_envs.hidden.rehearsal.torque_logs import (
    START,
    TorqueLogs,
    hideable,
    link_behind_gear,
)
from stiction_envs.hidden.torque_effects import COM, EFFECTS
from stiction_envs.robots import load_arm
from tests.gap.small_logs import found, hidden
from tests.refusal import refusal


def job_of(cause: str, *joints: int) -> CauseJob:
    return CauseJob(hideable(cause_named(cause)), joints)


def torque(logs: TorqueLogs, name: str, *size: float) -> np.ndarray:
    return logs.hidden(job_of(name, 0, 1), np.array(size))[0]


def test_a_surrogate_has_the_spectra_and_the_correlations_and_nothing_else():
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.normal(size=(4000, 2)), axis=0)
    x[:, 1] = 0.7 * x[:, 0] + 0.3 * x[:, 1]
    x -= x.mean(axis=0)
    y = surrogate(x, np.random.default_rng(2))
    np.testing.assert_allclose(*(np.abs(np.fft.rfft(z, axis=0))[1:-1] for z in (x, y)), rtol=1e-6)
    np.testing.assert_allclose(np.corrcoef(y.T), np.corrcoef(x.T), atol=1e-2)
    white = rng.normal(size=(4000, 1))
    again = surrogate(white, np.random.default_rng(3))
    assert abs(np.corrcoef(white[:, 0], again[:, 0])[0, 1]) < 0.06  # 4 standard errors


def test_noise_and_friction_are_those_of_the_log(logs):
    """White noise of 0.01 N·m, of which the filter leaves its share of the band."""
    nyquist = 0.5 / logs.data.dt
    part = np.sqrt(logs.data.recording.cutoff / nyquist)
    np.testing.assert_allclose(logs.left.std(axis=0), 0.01 * part, rtol=0.1)
    np.testing.assert_allclose(logs.friction, 0.5, atol=0.03)
    np.testing.assert_array_equal(logs.unknown_friction, logs.friction)


def test_gaps_and_several_logs_stay(two):
    """A gap splits a log; with nothing hidden nothing is named."""
    first, second = hidden(two, seconds=16.0), hidden(two, seconds=10.0, seed=2)
    late = np.where(np.arange(len(first.t)) < 1600, 0.0, 5.0)
    broken = replace(first, t=first.t + late, breaks=(1600,))
    logs = TorqueLogs(found(two, broken, second))
    assert len(logs.data.recording.runs) == 3
    (run,) = measure(jobs_of(logs, [])[0], logs, seed=1)
    assert run["named"] == []
    size = logs.size(job_of("torque_offset", 0, 1), np.array([0.1, 0.2]))
    np.testing.assert_allclose(size, [0.1, 0.2])


def test_poses_cannot_be_rehearsed(two):
    log = hidden(two)
    poses = replace(log, source="poses.csv", t=np.arange(len(log.t)) * 1.0, static=True)
    says = r"log2\.csv: poses at rest: expected joint logs"
    refusal(lambda: TorqueLogs(found(two, log, poses)), says)


@pytest.mark.parametrize("name", [c.name for c in CAUSES if c.name in EFFECTS])
def test_no_size_has_no_torque_and_more_has_more(logs, name):
    effect, size, rms = EFFECTS[name], np.zeros(2), []
    joints = [1] if name == "joint_elasticity" else [0, 1]
    for factor in (1e-6, 1.0, 2.0):
        size[joints] = factor * min(START, effect.largest / 2)
        rms.append(np.sqrt(np.mean(np.square(torque(logs, name, *size)), axis=0)))
    assert np.all(rms[0] < 1e-3 * rms[1] + 1e-9)
    seen = rms[1] > 1e-9  # the first axis is vertical
    assert seen.any()
    assert np.all(rms[2][seen] > 1.1 * rms[1][seen])


def test_friction_and_its_refinements_are_those_of_the_steady_law(logs):
    """In fast sliding it is the level; Stribeck friction is gone, an asymmetry is constant."""
    data, level = logs.data, logs.friction
    v, load = data.dq, np.abs(data.rigid)
    fast = np.abs(v) > 0.5  # beyond the reach of the filter from where a joint turns
    dry = torque(logs, "coulomb_friction", 0.3, 0.7)
    np.testing.assert_allclose(dry[fast], (np.sign(v) * [0.3, 0.7])[fast], atol=1e-6)
    assert np.abs(torque(logs, "stribeck_friction", 0.4, 0.4)[fast]).max() < 1e-6
    half = torque(logs, "direction_asymmetry", 0.2, 0.2)
    np.testing.assert_allclose(half[fast], (0.2 * level + 0 * v)[fast], atol=1e-6)
    grown = torque(logs, "load_dependent_friction", 0.05, 0.05)
    near = np.abs(grown - 0.05 * load * np.sign(v))[fast]
    assert near.max() < 0.01 * np.abs(grown).max()  # of the load of a row before
    since = data.recording.since_session[:, None]
    drift = torque(logs, "warm_up_drift", 0.3, 0.3)
    expected = 0.3 * level * since / since.max() * np.sign(v)
    np.testing.assert_allclose(drift[fast], expected[fast], atol=1e-4)


def test_a_payload_and_a_tilt_are_those_of_the_arm(logs, two_xml):
    """`load_arm` puts them into the MJCF, and pinocchio says what they weigh."""
    data = logs.data
    motion = data.q, data.dq, data.ddq
    own = load_arm(two_xml, payload=(0.4, *COM)).pinocchio()
    np.testing.assert_allclose(
        torque(logs, "payload", 0.4, 0.4), inverse_dynamics(own, *motion) - data.rigid, atol=1e-9
    )
    roll = pitch = 0.05 / np.sqrt(2)  # of these small angles the order hardly counts
    lean = [load_arm(two_xml, tilt=(a * roll, b * pitch)) for a in (-1, 1) for b in (-1, 1)]
    found = torque(logs, "base_tilt", 0.05, 0.05)
    off = [inverse_dynamics(x.pinocchio(), *motion) - data.rigid - found for x in lean]
    assert min(np.abs(x).max() for x in off) < 0.03 * np.abs(found).max()


def test_a_delay_shifts_the_torque(logs):
    rows, late = logs.data.nominal, torque(logs, "actuator_delay", 0.01, 0.01)
    np.testing.assert_allclose((rows + late)[:-3], rows[2:-1], atol=1e-9)  # two rows of 5 ms


def test_a_link_behind_a_gear_rests_on_it(logs):
    """The static limit, load over stiffness: a stiff gear swings far faster than the motion."""
    load = logs.data.recording.rigid[:, 1]
    x, v = link_behind_gear(logs.data, 1, 5e4)
    np.testing.assert_allclose(x, -load / 5e4, atol=0.02 * np.abs(load).max() / 5e4)
    assert np.abs(v).max() < 0.01 * np.abs(logs.data.dq).max()


@pytest.mark.parametrize(
    ("cause", "joints"),
    [("presliding_hysteresis", (0, 1)), ("payload", (0, 1)), ("joint_elasticity", (1,))],
)
def test_sizes_are_those_of_torques(logs, cause, joints):
    """Sizes of the noise, or of much more; or the largest size there is."""
    job = job_of(cause, *joints)
    for target in (logs.noise, 0.2 * logs.whole):
        size = logs.size(job, target)
        ratio = (np.sqrt(np.mean(np.square(logs.hidden(job, size)[0]), axis=0)) / target)[[*joints]]
        if job.what.arm_wide or job.what.coupled:
            ratio = ratio.max()
        at_the_end = np.all(size[list(joints)] == EFFECTS[cause].largest)
        assert at_the_end or np.allclose(ratio, 1.0, rtol=0.05)


def test_a_linear_cause_of_another_package_is_hidden_by_its_own_columns(logs):
    class Bias(TorqueOffset):
        name = "bias"
        parameters = (Parameter("bias_nm", "N·m"),)

    register(Bias())
    try:
        job = job_of("bias", 1)
        found, shown = logs.hidden(job, np.array([0.0, 2.0]))
        np.testing.assert_array_equal(found[5], [0.0, 2.0])
        assert (job.what.parameter, job.what.unit, shown) == ("bias_nm", "N·m", {"2": 2.0})
    finally:
        unregister("bias")
