"""The Single Joint Experiment: its protocol, its results. Thesis 3.2."""

import dataclasses
from functools import cache

import mujoco
import numpy as np
import pytest

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje import experiment as module
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Measurement,
    configurations,
    load_protocol,
)
from tests.refusal import refusal

JOINTS = [2, 4, 6, 7]
RATE, QUICK = 0.35, 0.5
"""Ramp rates of these tests [N·m/s]: the protocol's own, 0.07, takes longer and shows no more."""


@cache
def bench(robot: str = "panda", *, scatter: bool = True, seed: int = 0, **protocol: float):
    return SingleJointExperiment(
        robot, scatter=scatter, seed=seed, protocol=load_protocol(robot).replace(**protocol)
    )


@cache
def all_jobs(scatter: bool) -> dict[Configuration, Measurement]:
    """Four iterations of every configuration of four joints of the Panda."""
    b = bench(scatter=scatter, ramp_rate=RATE)
    return {m.job.configuration: m for m in b.run(b.jobs(JOINTS), iterations=4)}


def offset(b: SingleJointExperiment, c: Configuration) -> float:
    """Return the torque that balances the joint of a configuration without friction [N·m]."""
    p, (j, load, _) = b.sticking.parameters, c.index
    signed = np.clip(b.poses.signed[j, load], -p.load_high[j], p.load_high[j])
    return p.offset[j] + p.gravity_error[j] * signed


def one(b: SingleJointExperiment, job: Job, iterations: int = 1) -> Measurement:
    return next(iter(b.run([job], iterations=iterations)))


def test_every_configuration_is_measured():
    found = all_jobs(True)
    assert set(found) == set(configurations(7, JOINTS))
    for c, m in found.items():
        assert m.tau.shape == (4,)
        assert np.all(np.isfinite(m.tau))
        assert np.all(c.sign * m.tau > 0)


def test_torque_is_the_ramp_at_the_threshold():
    """|τ| = rate × time, on the grid of the controller's ticks, in the trace's last block."""
    for c, m in all_jobs(False).items():
        steps = c.sign * m.tau / (RATE * 1e-3)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
        for tau, trace in zip(m.tau, m.traces, strict=True):
            blocks = abs(tau) / RATE / m.trace_dt
            assert len(trace) - 2 <= blocks < len(trace) - 1
        assert np.all(m.start_torque == 0.0)


def test_first_iteration_differs_from_later_ones():
    """The arm first comes from the other side; then each return starts where the ramp ended."""
    differing = 0
    for c, m in all_jobs(False).items():
        # the first approach comes from behind, the later ones from ahead
        assert c.sign * (m.start[0] - m.start[1]) < 0
        differing += abs(m.tau[0] - m.tau[1]) > 1e-3
        assert np.ptp(m.tau[1:]) < 1e-3
        assert abs(m.tau[0] - m.tau[1]) < 0.15 * abs(m.tau[1])
    assert differing > 10


def test_breakaway_is_stiction_plus_slide_and_offset():
    """F_c < τ − offset < F_s + slide: from F_s on, r t drives at least r t³/6J of the 0.15 rad."""
    b = bench()
    p = b.sticking.parameters
    model = b.sticking.arm.model()
    data, full = mujoco.MjData(model), np.zeros((7, 7))
    for c, m in all_jobs(False).items():
        j, load, direction = c.index
        level = p.stiction_at(b.poses.load[:, load])[j, direction]
        data.qpos[:] = b.poses.q[j, load]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        time = (6 * (full[j, j] + p.rotor_inertia[j]) * 0.15 / RATE) ** (1 / 3)
        slide = RATE * time + p.viscous[j, direction] * 3 * 0.15 / time
        friction = c.sign * (m.mean - offset(b, c))
        ripple = p.ripple_amplitude[j]
        assert level * p.coulomb_ratio[j, direction] - ripple < friction, c
        assert friction < level + slide + ripple, c
        # and expected() plans with it
        assert b.expected(Job(c)) == pytest.approx(abs(c.sign * level + offset(b, c)))


LIGHT = Configuration(7, "load", "+")


def test_scatter_is_seeded():
    """Same seed, same bits; another seed, other torques; phases and noise belong to the seed."""
    first, again, other = (
        one(bench.__wrapped__(seed=seed, ramp_rate=QUICK), Job(LIGHT), 3).tau for seed in (3, 3, 4)
    )
    assert again.tobytes() == first.tobytes()
    assert np.all(other != first)


def test_iterations_scatter():
    """With scatter repeats differ as printed ones do: a few per cent, not more, not less."""
    relative = [m.std / abs(m.mean) for m in all_jobs(True).values()]
    assert min(relative) > 0
    assert 0.01 < np.median(relative) < 0.06
    assert all(np.std(m.tau[1:]) < 1e-3 for m in all_jobs(False).values())


def test_jobs_do_not_depend_on_each_other(monkeypatch):
    """A job's result is the same alone, among others, and with fewer simulations than jobs."""
    b = bench(ramp_rate=QUICK)
    jobs = [
        Job(Configuration(joint, "load", d), f, a)
        for joint in (5, 6, 7)
        for d in "+-"
        for f, a in ((0.0, 0.0), (30.0, 0.3))
    ]
    together = {m.job: m for m in b.run(jobs, iterations=2)}
    monkeypatch.setattr(module, "MAX_SIMULATIONS", 3)
    squeezed = {m.job: m for m in b.run(jobs[::-1], iterations=2)}
    for job in jobs[::4]:
        single = one(b, job, 2)
        for found in (together[job], squeezed[job]):
            assert found.tau.tobytes() == single.tau.tobytes()
            assert found.start.tobytes() == single.start.tobytes()
            assert [t.tobytes() for t in found.traces] == [t.tobytes() for t in single.traces]


def test_dither_lowers_the_wrist_and_low_frequency_most():
    """Joint 7: 15 Hz frees far more than 80 Hz (sources.md 4.3)."""
    b = bench(scatter=False)
    none, slow, fast = (one(b, Job(LIGHT, f, a), 2).mean for f, a in ((0, 0), (15, 0.6), (80, 0.6)))
    assert slow < 0.85 * none
    assert fast < none
    assert none - slow > 3 * (none - fast)


def test_recorded_torque_excludes_the_dither():
    """A constant dither offset moves the joint but is not in τ (thesis 3.2)."""
    b = bench(scatter=False, ramp_rate=QUICK)
    plain, pushed = (one(b, Job(LIGHT, offset_nm=o)).mean for o in (0.0, 0.2))
    assert plain - pushed == pytest.approx(0.2, abs=0.02)


def test_100_hz_dither_at_200_hz_and_phase_zero_does_nothing():
    """At Nyquist the samples are ±A sin φ; without scatter φ = 0 (sources.md 2.6).

    The same dither from a controller of 1 kHz is felt, and so is another frequency at 200 Hz.
    """
    b = bench("iiwa7", scatter=False, ramp_rate=QUICK)
    slow, fast = (
        b.replace(interface=dataclasses.replace(b.interface, controller_rate_hz=rate))
        for rate in (200, 1000)
    )
    none, aliased, felt = Job(LIGHT), Job(LIGHT, 100.0, 3.0), Job(LIGHT, 15.0, 1.0)
    plain = one(slow, none).mean
    assert one(slow, aliased).mean == plain
    assert one(fast, aliased).mean < one(fast, none).mean
    assert one(slow, felt).mean < plain


def test_iiwa_ramps_start_at_the_averaged_torque():
    """Thesis 3.2: the iiwa's ramp begins at the averaged external torque, the Panda's at zero."""
    b = bench("iiwa7", ramp_rate=QUICK)
    jobs = [Job(Configuration(j, "no_load", d)) for j in (5, 6, 7) for d in "+-"]
    p = b.sticking.parameters
    for m in b.run(jobs, iterations=2):
        j = m.job.configuration.index[0]
        assert np.all(m.start_torque != 0.0)
        # the pose reached is not exactly the pose: gravity_error sees a little of it
        reached = 0.1 * abs(p.gravity_error[j]) * b.poses.load[j, 0]
        expected = offset(b, m.job.configuration)
        np.testing.assert_allclose(m.start_torque, expected, atol=0.002 + reached)


def test_stuck_joint_gives_nan():
    """A ramp that ends before the joint moves is NaN, and so is the mean."""
    # given up at 0.5 of stiction plus offset: nothing can move by then
    b = bench(scatter=False, ramp_rate=QUICK, give_up_factor=0.5)
    m = one(b, Job(Configuration(6, "load", "-")), 2)
    assert np.all(np.isnan(m.tau))
    assert np.isnan(m.mean)
    # other jobs of the same run are unharmed by it, and later iterations run
    assert len(m.traces) == 2


def test_arm_that_cannot_be_held_is_an_error():
    b = bench(ramp_rate=QUICK, hold_stiffness=0.01)
    with pytest.raises(ExperimentError, match=r"joint \d stopped .* from its pose.*hold_stiffness"):
        one(b, Job(LIGHT))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"ramp_rate": 0.0}, "ramp_rate is 0.0: expected .* > 0"),
        ({"threshold": -1.0}, "threshold is -1.0: expected .* > 0"),
        ({"iterations": 0}, "iterations is 0: expected .* > 0"),
        ({"pose_scatter": float("nan")}, "pose_scatter"),
        ({"settle_time": float("inf")}, "settle_time"),
    ],
)
def test_bad_protocols(change, says):
    refusal(lambda: load_protocol("panda").replace(**change), says)


def test_bad_configurations():
    refusal(lambda: Configuration(1, "heavy", "+"), "unknown load 'heavy'")
    refusal(lambda: Configuration(1, "load", "up"), "unknown direction 'up'")
    for joint in (0, 8, -1):
        refusal(lambda joint=joint: bench().jobs([joint]), f"unknown joint {joint}")
    twice = [c.index for c in configurations(7, [3, 3])]
    assert twice == [(2, load, direction) for load in (0, 1) for direction in (0, 1)]
