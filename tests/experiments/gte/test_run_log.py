"""Logs of runs, on arms with known motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from stiction_envs.control import rotation
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run, load_gte_protocol
from stiction_envs.experiments.gte.sampling import RunLog
from tests.control.rig import from_rotation_vector
from tests.experiments.gte.made_up import RATE, made_up
from tests.experiments.gte.short_paths import DITHER, SOFT, bench, following

START = np.array([0.0, 1.0, 0.0, 0.0])
"""Orientation at the start: a hand that looks down."""


class Stub:
    """The part of a rig that a log reads; two arms at different places, moved by ``move``."""

    nsim, n = 2, 7

    def __init__(self, move) -> None:
        self.move, self.count = move, 0
        self.end_effector = SimpleNamespace(
            position=np.array([[0.3, 0.0, 0.5], [1.0, 2.0, 3.0]]),
            quaternion=np.tile(START, (2, 1)),
        )
        self.flags = {name: np.zeros(2, dtype=bool) for name in FLAGS}
        self.power, self.applied = np.zeros(2), np.zeros((2, 7))
        self.sequencer = SimpleNamespace(
            finished=np.ones(2, dtype=bool),
            arrays=SimpleNamespace(
                accepted=np.array([[0.0, 1.0], [0.0, 1.0]]),
                reached=np.array([[1.0, 2.0], [1.0, 2.0]]),
            ),
        )

    def advance(self, steps, sampling) -> None:
        for k in range(steps):
            self.move(self, self.count * 1e-3)
            position, quaternion = self.end_effector.position, self.end_effector.quaternion
            sampling.position[k], sampling.quaternion[k] = position, quaternion
            s = k // sampling.stride
            sampling.power[s] += self.power
            for flag, name in enumerate(FLAGS):
                sampling.flags[s, :, flag] |= self.flags[name]
            self.count += 1


def logged(move, seconds: float = 3.0) -> Run:
    """The run of a stub that ``move(stub, t)`` moves every 1 ms."""
    log = RunLog(Stub(move), load_gte_protocol(), 100)
    for _ in range(round(seconds * 10)):
        log.advance()
    return log.run(made_up().case, np.ones(2, dtype=bool), 2)


def test_samples_are_the_first_of_their_control_steps():
    def move(stub, t):
        stub.end_effector.position[:, 0] = t

    run = logged(move)
    assert run.actual.shape == (2, 300, 6)
    np.testing.assert_allclose(run.actual[0, :, 0], run.time)
    np.testing.assert_allclose(np.diff(run.time), 1 / RATE)
    np.testing.assert_array_equal(run.actual[:, :, 3], np.pi)


@pytest.mark.parametrize("frequency", [15.0, 80.0])
def test_vibration_of_a_pure_sine(frequency):
    """RMS is amplitude/√2 times the high-pass's gain, from the first period to the last."""

    def move(stub, t):
        stub.end_effector.position[:, 1] = [1e-3 * np.sin(2 * np.pi * frequency * t), 2.0]

    run = logged(move)
    gain = 1 / np.sqrt(1 + (load_gte_protocol().vibration_low / frequency) ** 4)
    rms = np.sqrt(np.mean(run.mean_square[0, 100:, 1]))
    assert rms == pytest.approx(gain * 1e-3 / np.sqrt(2), rel=0.01)
    assert run.mean_square[0, :, 1].max() < 1.1e-3**2  # nothing rings from block to block
    assert not run.mean_square[1].any()
    assert not run.mean_square[:, :, [0, 2]].any()


@pytest.mark.parametrize(("axis", "path"), [(0, 7.0), (1, 0.0), (2, 7.0)])
def test_turning_vibrates_by_the_lever(axis, path):
    """A turn counts as the motion of a point at the lever; more than one turn adds nothing."""
    protocol, frequency = load_gte_protocol(), 30.0

    def move(stub, t):
        vector = np.zeros(3)
        vector[axis] = path * t + 2e-3 * np.sin(2 * np.pi * frequency * t)
        turn = from_rotation_vector(vector)
        sign = -1.0 if 1.1 < t < 1.3 else 1.0  # the same orientation
        stub.end_effector.quaternion[0] = sign * rotation.multiply(turn, START)

    run = logged(move)
    gain = 1 / np.sqrt(1 + (protocol.vibration_low / frequency) ** 4)
    rms = np.sqrt(np.mean(run.mean_square[0, 100:, 3 + axis]))
    assert rms == pytest.approx(gain * protocol.vibration_lever * 2e-3 / np.sqrt(2), rel=0.01)
    others = np.delete(run.mean_square[0], 3 + axis, axis=1)
    assert others.max() < 1e-20
    assert not run.mean_square[1].any()


def test_dither_power_and_torque_rate():
    """|τ q̇| of every joint, also while the joint moves against the torque; N·m per second."""
    b = bench()
    case = Case(trajectory="there", stiffness=SOFT, dither=DITHER)
    [run] = b.run([case], iterations=1)
    rig = following(b, case)
    power, rate, before = [], [], np.zeros(7)
    for _ in range(100):
        speed = rig.plant.state[1][0, rig.plant.sticking.motor].copy()
        rig.advance(1)
        power.append(np.abs(rig.dither_torque[0] * speed).sum())
        rate.append(np.abs(rig.applied[0] - before) / 1e-3)
        before = rig.applied[0].copy()
    stride = round(1000 / b.protocol.sample_rate)
    expected = np.reshape(power, (-1, stride)).mean(axis=1)
    np.testing.assert_allclose(run.dither_power[0, : 100 // stride], expected)
    assert np.all(run.torque_rate[0] >= np.max(rate, axis=0) - 1e-9)
    assert run.torque_rate[0].max() < 2 * np.max(rate)


def test_record_ends_with_its_own_tail():
    """Later samples do not count: a case's run is the same in any batch."""

    def move(stub, t):
        stub.power[:] = 1e6 * (t > 3.5)
        stub.flags["singular"][:] = t > 3.5

    run = logged(move, seconds=5.0)
    assert run.time[-1] == pytest.approx(2.99)
    assert not run.dither_power.any()
    assert not run.flags["singular"].any()
