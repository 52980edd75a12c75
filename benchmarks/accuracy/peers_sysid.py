"""`mujoco.sysid` as its README says: parameters on a spec, sequences, residual, `optimize`.

pip install "mujoco[sysid]"; Gauss–Newton on rollouts, whose Jacobian is of finite differences.
"""

from importlib import import_module
from typing import Any

import mujoco
import numpy as np

from stiction_envs.robots import Arm

Array = np.ndarray
WINDOW = 0.5
"""Length of a rollout from a measured state [s]: open-loop, an arm leaves its log soon;
assumed."""
MOST = 12
"""Windows, evenly picked: each is rolled out once per parameter and iteration; assumed."""
STEP = 0.002
"""Time step of the simulations [s]; assumed."""
ITERATIONS = 25
"""At most; assumed."""
STILL = 1e-3
"""Largest angle [rad] or speed [rad/s] of a joint that holds still in a window; assumed."""


class Sysid:
    """A model that `mujoco.sysid` identified, and what it says of it."""

    def __init__(self, arm: Arm, signals: list[Any], dt: float) -> None:
        """Identify from stretches of signals (q, dq, ddq, tau, each (K, n)) on even times."""
        from absl import logging

        # by name: mypy would take all of mujoco for what this package types
        sysid = import_module("mujoco.sysid")

        logging.set_verbosity(logging.ERROR)
        spec = arm.spec()
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        for joint in spec.joints:
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        for name in arm.joint_names:
            motor = spec.add_actuator(name=f"{name}_motor", target=name)
            motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
            for kind, end in (
                (mujoco.mjtSensor.mjSENS_JOINTPOS, "pos"),
                (mujoco.mjtSensor.mjSENS_JOINTVEL, "vel"),
            ):
                spec.add_sensor(
                    name=f"{name}_{end}",
                    type=kind,
                    objtype=mujoco.mjtObj.mjOBJ_JOINT,
                    objname=name,
                )
        model = spec.compile()
        params = sysid.ParameterDict()
        for name in arm.joint_names:
            body = model.body(model.joint(name).bodyid[0]).name
            params.add(
                sysid.body_inertia_param(spec, model, body, inertia_type=sysid.InertiaType.MassIpos)
            )
            for what, nominal, most in (
                ("damping", 0.2, 10.0),
                ("frictionloss", 0.2, 10.0),
                ("armature", 0.01, 2.0),
            ):
                params.add(
                    sysid.Parameter(
                        f"{name}_{what}", nominal, 0.0, most, modifier=_setter(name, what)
                    )
                )
        windows = _windows(signals, round(WINDOW / dt))
        sequences = sysid.ModelSequences(
            "arm",
            spec,
            [f"window{k}" for k in range(len(windows))],
            [sysid.create_initial_state(model, q[0], dq[0], np.zeros(0)) for q, dq, _ in windows],
            [
                sysid.TimeSeries.from_control_names(np.arange(len(q)) * dt, tau, model)
                for q, _, tau in windows
            ],
            [
                sysid.TimeSeries.from_names(
                    np.arange(len(q)) * dt,
                    np.stack([q, dq], axis=2).reshape(len(q), -1),
                    model,
                )
                for q, dq, _ in windows
            ],
        )
        # residuals are over each signal's own size, which a joint that holds still has not
        sizes = [np.abs(x).max(axis=0).min() for q, dq, _ in windows for x in (q, dq)]
        moving = min(sizes) > STILL
        transform = sysid.SignalTransform(normalize=moving)
        residual = sysid.build_residual_fn(
            models_sequences=[sequences], modify_residual=transform.apply
        )
        self.params, result = sysid.optimize(
            params, residual, optimizer="mujoco", max_iters=ITERATIONS, verbose=False
        )
        self.stopped = len(result.extras["objective"]) >= ITERATIONS
        left, *_ = residual(result.x, self.params)
        _, self.half = sysid.calculate_intervals([x.ravel() for x in left], result.jac)
        self.model = sysid.apply_param_modifiers(self.params, spec)
        self.dof = np.array([self.model.joint(x).dofadr[0] for x in arm.joint_names])

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return (T, n) torque of what it identified (`mj_inverse`) [N·m]."""
        data, out = mujoco.MjData(self.model), np.empty_like(q)
        for k in range(len(q)):
            data.qpos[self.dof], data.qvel[self.dof], data.qacc[self.dof] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(self.model, data)
            out[k] = data.qfrc_inverse[self.dof]
        return out

    def says(self) -> dict[str, str]:
        """Return what it says of causes and of trust."""
        x, (low, high) = self.params.as_vector(), self.params.get_bounds()
        wide = int((np.abs(self.half) > 0.3 * np.abs(x)).sum())
        near = int(((x - low < 1e-6 * (high - low)) | (high - x < 1e-6 * (high - low))).sum())
        return {
            "causes": f"{len(x)} parameters that the user chose (mass and centre of each link, "
            "damping, friction loss and armature of each joint); none is said to be a fault",
            "trust": f"{wide} of {len(x)} parameters with a 95 % interval wider than 30 %, "
            f"{near} on a bound"
            + (f"; stopped after {ITERATIONS} iterations, still falling" if self.stopped else ""),
        }


def _setter(joint: str, what: str) -> Any:
    def modify(spec: Any, parameter: Any) -> None:
        value = float(parameter.value[0])
        # damping is a polynomial in MuJoCo 4
        setattr(spec.joint(joint), what, [value, 0, 0] if what == "damping" else value)

    return modify


def _windows(signals: list[Any], count: int) -> list[tuple[Array, Array, Array]]:
    out = [
        (s.q[k : k + count], s.dq[k : k + count], s.tau[k : k + count])
        for s in signals
        if not s.static
        for k in range(0, len(s.q) - count, count)
    ]
    return [out[int(k)] for k in np.unique(np.linspace(0, len(out) - 1, MOST).astype(int))]
