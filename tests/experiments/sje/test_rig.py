"""The machine of the Single Joint Experiment: what reaches a joint, and how far it is shaken."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.experiments.sje.rig import RAMP

GATE, A, F = 0.05, 0.6, 15.0


@pytest.mark.parametrize("rate_hz", [1000, 125])
def test_gate_is_closed_by_the_speed_of_every_cycle(rate_hz):
    """exp(-(v/v_gate)^2) with the speed read when the command is computed, held in between."""
    experiment = SingleJointExperiment("panda", scatter=False)
    interface = TorqueInterface(
        controller_rate_hz=rate_hz,
        lowpass_hz=0.0,
        torque_rate=np.full(7, np.inf),
        torque_limit=np.full(7, 100.0),
    )
    rig = experiment.replace(interface=interface).rig(1)
    ids = np.array([0])
    rig.place(ids, [Configuration(7, "load", "+")])
    rig.approach(ids, [(0,)])
    rig.set_dither(ids, amplitude=A, frequency=F, gate_velocity=GATE)
    while rig.stage[0] != RAMP:
        rig.advance(ids)
    run, seen = rig.plant.run, []

    def watched(torque, ids, **others):
        seen.append((torque[0, :, 6].copy(), rig.plant.velocity[0, 6]))
        return run(torque, ids, **others)

    rig.plant.run = watched
    for _ in range(30):
        rig.advance(ids)
    step, speed, closed = 0, 0.0, []
    for torque, now in seen:
        for value in torque:
            cycle = step // interface.hold_steps * interface.hold_steps
            if step == cycle:
                speed = now
            closed.append(np.exp(-((speed / GATE) ** 2)))
            wave = A * np.sin(2 * np.pi * F * cycle * 1e-3) * closed[-1]
            expected = rig.start_torque[0] + rig.protocol.ramp_rate * cycle * 1e-3 + wave
            assert value == pytest.approx(expected, abs=1e-9)
            step += 1
    assert min(closed) < 0.8  # it shook fast enough for the gate to matter


def test_displacement_nears_that_of_a_free_joint():
    """A sin(wt) swings a free rotor by A/(J w^2); friction is little against ten times itself."""
    experiment = SingleJointExperiment("panda", scatter=False)
    fast = dataclasses.replace(experiment.interface, torque_rate=np.full(7, np.inf))
    experiment = experiment.replace(interface=fast)
    c = Configuration(7, "load", "+")
    base, shaken = (
        next(iter(experiment.run([job], iterations=1))) for job in (Job(c), Job(c, 80.0, 4.0))
    )
    rotor = float(experiment.sticking.parameters.rotor_inertia[6])
    gain = experiment.interface.lowpass_gain
    lowpass = gain / abs(1 - (1 - gain) * np.exp(-2j * np.pi * 80.0 * 1e-3))
    free = 4.0 * lowpass / (rotor * (2 * np.pi * 80.0) ** 2) / np.sqrt(2)
    assert base.displacement == 0.0
    assert shaken.displacement == pytest.approx(free, rel=0.06)
