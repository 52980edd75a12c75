"""The measured angle that ends a Single Joint Experiment, and the delay of commands."""

import numpy as np
import pytest

from stiction_envs.control.sensing import Sensing
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job, load_protocol

FREE, LOADED = Configuration(7, "no_load", "+"), Configuration(6, "load", "-")
JOBS = [Job(FREE), Job(LOADED), Job(FREE, 15.0, 0.6, gate_velocity=0.05)]
BAD = Sensing(
    angle_noise=1e-4,
    speed="difference",
    speed_cutoff=8.0,
    measurement_delay=0.0013,
    command_delay=0.001,
    missed_cycles=0.05,
)
RATE = 0.35
"""Growth of the commanded torque in these tests [N·m/s]: slower ramps show no more."""


def torques(sensing, jobs=JOBS, robot="panda", **options):
    protocol = load_protocol(robot).replace(ramp_rate=RATE)
    experiment = SingleJointExperiment(robot, sensing=sensing, protocol=protocol, **options)
    found = {repr(m.job): m.tau for m in experiment.run(jobs, iterations=2)}
    return [found[repr(job)] for job in jobs]


def test_senses_without_errors_change_no_bit():
    """All of the machinery runs; speeds are differences, so that no dither is gated here."""
    ideal = torques("ideal", JOBS[:2], "iiwa7")
    assert all(map(np.array_equal, ideal, torques(Sensing(speed_cutoff=9.0), JOBS[:2], "iiwa7")))


def test_a_ramp_goes_on_until_a_late_reading_is_there():
    """Law checked: the torque grows by rate · (delay of the command + of the reading)."""
    late = Sensing(measurement_delay=0.006, command_delay=0.004)
    usual, delayed = (np.abs(torques(s, JOBS[:2], scatter=False)) for s in ("ideal", late))
    np.testing.assert_allclose(delayed - usual, 0.010 * RATE, rtol=0, atol=2e-3 * RATE)


@pytest.mark.slow
def test_a_job_reads_the_same_bits_in_any_batch_and_on_any_threads():
    together = torques(BAD, threads=2)
    for job, tau in zip(JOBS, together, strict=True):
        assert np.array_equal(torques(BAD, [job], threads=1)[0], tau)
