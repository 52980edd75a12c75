"""The controller on Warp's device is the host's controller (extra warp)."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.dither.dither import Dither
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots import load_arm

pytest.importorskip("mujoco_warp")
import warp as wp

from stiction_envs.control.device import cycle

pytestmark = pytest.mark.slow  # the kernels load for seconds, and compile for a minute at first
N = 3
SOFT = (200.0, 20.0, 0.0)


def experiment(robot: str = "panda", **options: object) -> GeneratedTrajectoryExperiment:
    return GeneratedTrajectoryExperiment(robot, engine="warp", seed=1, **options)


def started(e: GeneratedTrajectoryExperiment, stiffness=SOFT, *, on_host: bool = False) -> GTERig:
    rig = e.rig(N, 5)
    if on_host:
        rig._device = None
    paths = [e.path(name) for name in ("triangle", "pentagon", "triangle")]
    rig.begin(np.arange(N), paths, np.tile(stiffness, (N, 1)), [(k,) for k in range(N)])
    return rig


def shaken(rig: GTERig, **dither) -> GTERig:
    share = np.linspace(0.0, 0.5, N)[:, None]
    given = {"amplitude": share, "frequency": 33.0, **dither}
    rig.set_dither(np.arange(N), **given)
    return rig


def log(rig: GTERig, steps: list[int], **options) -> tuple[np.ndarray, np.ndarray]:
    """Follow; return poses (K, N, 7) of every step, and all that is left at the end."""
    poses = []

    def watch() -> None:
        pose = rig.end_effector
        poses.append(np.concatenate([pose.position, pose.quaternion], axis=1))

    for count in steps:
        rig.advance(count, watch, **options)
    c, s = rig.controller, rig.sequencer
    left = (rig.plant.position, rig.plant.velocity, rig.plant.bristle, rig.plant.stiction)
    arrays = (*left, c.wanted, c.command, c.error, *c.reference, rig.applied, rig.dither_torque)
    return np.array(poses), np.concatenate(
        [x.reshape(N, -1) for x in (*arrays, s.index, s.accepted_at, rig.step)], axis=1
    )


ARMS = {
    "panda": ("panda", {}, SOFT, {}),
    "iiwa, controller of 200 Hz": ("iiwa7", {}, SOFT, {}),
    "nullspace": ("panda", {}, (200.0, 20.0, 5.0), {}),
    "gates": ("panda", {}, SOFT, {"gate_velocity": 0.05, "offset": 0.2}),
    "gates of a slow controller": ("iiwa7", {}, SOFT, {"gate_velocity": 0.05}),
    "triangle": ("panda", {}, SOFT, {"waveform": "triangle"}),
}


@pytest.mark.parametrize("case", ARMS)
def test_steps_are_those_of_the_hosts_controller_on_the_same_engine(case):
    """Physics is the same, so that all that is apart is the controllers' rounding."""
    robot, options, stiffness, dither = ARMS[case]
    e, steps = experiment(robot, **options), [100, 40, 200, 100]
    there = log(shaken(started(e, stiffness), **dither), steps)
    here = log(shaken(started(e, stiffness, on_host=True), **dither), steps)
    for a, b in zip(there, here, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-6, rtol=2e-6)
    assert np.ptp(here[0][:, :, :3], axis=0).max() > 1e-4


def test_a_wrong_model_of_the_controller():
    wrong = load_arm("panda", payload=(1.0, 0.0, 0.0, 0.05))
    e = experiment("panda", controller_model=wrong)
    there, here = (log(started(e, on_host=host), [60, 60]) for host in (False, True))
    np.testing.assert_allclose(there[1], here[1], atol=2e-6, rtol=2e-6)
    right = log(started(experiment("panda")), [60, 60])
    assert np.nanmax(np.abs(right[1] - there[1])) > 1e-3


def test_no_error_no_torque():
    """At rest where the reference is, the controller adds nothing to the robot's gravity."""
    rig = started(experiment("panda", scatter=False))
    rig.advance(1)
    assert np.abs(rig.controller.error[:, :6]).max() < 1e-4
    assert np.abs(rig.controller.wanted).max() < 0.05
    rig.end_effector.read()
    rig.controller.reset(
        None, rig.end_effector.position, rig.end_effector.quaternion, rig.plant.position
    )
    rig.plant.state[1][:] = 0.0
    rig.sequencer.start(
        *(None, rig.end_effector.position[:, None], rig.end_effector.quaternion[:, None]),
        *(rig.end_effector.position, rig.end_effector.quaternion, rig.step * 1e-3),
    )
    rig.advance(1)
    assert np.abs(rig.controller.wanted).max() < 1e-5  # float32's kinematics


def test_no_stiffness_no_torque():
    rig = started(experiment("panda"), (0.0, 0.0, 0.0))
    rig.advance(300)
    assert not rig.controller.wanted.any()
    assert not rig.applied.any()
    rig = started(experiment("panda"))
    rig.advance(300)
    assert np.abs(rig.applied).max() > 0.1


@pytest.mark.parametrize("speed", [0.0, 0.01, 3.0])
def test_gates_are_those_of_the_dither(speed):
    dq = speed * np.random.default_rng(0).normal(size=(N, 7))
    v, offset = np.full((N, 7), 0.02), np.linspace(0.0, 0.3, 7) * np.ones((N, 1))
    v[:, 3] = np.inf
    given = {"amplitude": np.ones((N, 7)), "frequency": 12.0, "offset": offset}
    dither = Dither(gate_velocity=v, **given)
    t = np.array([0.0, 0.013, 7.7])
    torque = wp.array(dither.ungated(t), dtype=wp.float64)
    inputs = [wp.array(x, dtype=wp.float64) for x in (dq, 1 / v, offset)]
    wp.launch(cycle.gate, dim=(N, 7), inputs=inputs, outputs=[torque])
    np.testing.assert_allclose(torque.numpy(), dither.torque(t, dq), rtol=1e-14, atol=1e-15)


def test_a_run_is_that_of_mujoco():
    """Errors, vibration, torque rate, power and flags of whole runs, gated and not."""
    rows = tuple(
        AmplitudeRow(joint=j, frequency_hz=40.0, amplitude_nm=0.4, gate_rad_s=g)
        for j, g in ((5, 0.05), (7, 0.0))
    )
    case = Case(trajectory="triangle", stiffness=SOFT, dither=rows)
    runs = [
        GeneratedTrajectoryExperiment("panda", engine=engine).run([case], iterations=2)[0]
        for engine in ("mujoco", "warp")
    ]
    here, there = runs
    np.testing.assert_allclose(there.accepted, here.accepted)
    for name, close in (("actual", 1e-5), ("reference", 1e-5), ("dither_power", 1e-3)):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), atol=close)
    np.testing.assert_allclose(there.torque_rate, here.torque_rate, rtol=1e-3)
    np.testing.assert_allclose(there.mean_square, here.mean_square, rtol=1e-2, atol=1e-12)
    assert all(np.array_equal(there.flags[k], here.flags[k]) for k in here.flags)
    assert here.dither_power.max() > 0.01
