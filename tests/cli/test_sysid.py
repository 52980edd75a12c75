"""MuJoCo's own `sysid` as a client of the models that commands write: load, roll out, estimate."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco import sysid

from stiction_envs.friction.model import COULOMB, STICTION
from stiction_envs.hidden import excited_logs as excited
from stiction_envs.robots import load_arm
from tests.gap.small_logs import RATE, motion, write_csv

SECONDS = 1.5
CHANGED = {"damping": 2.0, "level": 1.3}
"""What the logged arm's second joint has over the model's: viscous friction, dry friction [-]."""


def with_sensors(path: Path) -> mujoco.MjSpec:
    """Read a model and give it what `sysid` compares."""
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in spec.joints:
        spec.add_sensor(
            name=f"q_{joint.name}",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
        )
    return spec


def set_friction(spec: mujoco.MjSpec, nominal: mujoco.MjModel, name: str, by: float) -> None:
    """Multiply the second joint's nominal damping, or its dry friction's level."""
    if name == "damping":
        spec.joints[1].damping = [by * float(nominal.dof_damping[1]), 0.0, 0.0]
    else:
        prm = np.array(spec.actuators[1].biasprm)
        levels = [COULOMB, STICTION]
        prm[levels] = by * nominal.actuator_biasprm[1, levels]
        spec.actuators[1].biasprm = prm


def factor(nominal: mujoco.MjModel, name: str) -> sysid.Parameter:
    """Return a factor that starts at 1."""

    def modify(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        set_friction(spec, nominal, name, float(parameter.value[0]))

    return sysid.Parameter(name, 1.0, 0.5, 4.0, modifier=modify)


@pytest.fixture(params=["export", "diagnose"])
def written(request, cli, two, work) -> Path:
    """Return a command's model.xml of the small arm."""
    if request.param == "export":
        ran = cli("export", two, "--out", "out")
    else:
        t, q, dq, ddq = motion(2, seconds=8.0)
        log = excited.log(load_arm(two), (q, dq, ddq), RATE, noise=0.02, seed=1)
        tau = log.tau + 0.5 * np.sign(dq) + 0.4 * dq
        write_csv(work / "log.csv", dataclasses.replace(log, t=t, tau=tau))
        ran = cli("diagnose", "log.csv", "--robot", two, "--out", "out")
    assert ran.code == 0, ran.err
    return work / "out" / "model.xml"


def test_sysid_finds_friction_that_was_changed_in_a_written_model(written):
    """Its estimate, from rollouts of the model as it is, is the arm that the log is of."""
    logged = with_sensors(written)
    nominal = with_sensors(written).compile()
    for name, by in CHANGED.items():
        set_friction(logged, nominal, name, by)
    t, torque, stamps, q = log_of(logged.compile())
    spec = with_sensors(written)
    model = spec.compile()
    assert np.ptp(q, axis=0).min() > 0.2, "the arm has to move"
    start = sysid.create_initial_state(model, np.zeros(2), np.zeros(2), np.zeros(model.na))
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        ["log"],
        [start],
        [sysid.TimeSeries.from_control_names(t, torque, model)],
        [sysid.TimeSeries.from_names(stamps, q, model)],
    )
    parameters = sysid.ParameterDict()
    for name in CHANGED:
        parameters.add(factor(nominal, name))
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    found, _ = sysid.optimize(parameters, residual, optimizer="mujoco", max_iters=15, verbose=False)
    np.testing.assert_allclose(found.as_vector(), list(CHANGED.values()), rtol=1e-4)


def log_of(model: mujoco.MjModel) -> tuple[np.ndarray, ...]:
    """Return what a simulated arm logs: sensors as MuJoCo stamps them, at the end of the step.

    Returns:
        Times (K,) [s] of controls (K, nu) [N·m], and times (K,) of angles (K, 2) [rad].
    """
    t = np.arange(0, SECONDS, model.opt.timestep)
    torque = np.zeros((len(t), model.nu))  # a diagnosis may have added other actuators
    torque[:, :2] = np.array([2.5, 2.0]) * np.sin(2 * np.pi * t[:, None] * [1.5, 1.0])
    data = mujoco.MjData(model)
    stamps, q = np.empty(len(t)), np.empty((len(t), 2))
    for k, now in enumerate(torque):
        data.ctrl[:] = now
        mujoco.mj_step(model, data)
        stamps[k], q[k] = data.time, data.sensordata
    return t, torque, stamps, q
