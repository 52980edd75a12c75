"""What acts on each joint of an arm along logs of its motion, from the rigid arm."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion, command_nodes
from stiction_envs.gap.signals.filters import lowpass
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
CUTOFF_HZ = 5.0
"""Bandwidth of the accelerations that couple the joints [Hz]: angles come in steps of about a
milliradian; assumed."""
TILT = 1e-3
"""Angle over which the slope of gravity is taken [rad]; assumed."""
OUTSIDE = 1.0
"""Time for which a command counts as held before and after a segment [s]; assumed."""


def segments(logs: Sequence[ServoLog]) -> list[tuple[int, slice]]:
    """Return the segments that have a duration: number of the log, rows."""
    return [(k, s) for k, log in enumerate(logs) for s in log.segments if s.stop - s.start > 1]


def joint_motions(
    arm: Arm, logs: Sequence[ServoLog], zeros: Array | float = 0.0
) -> list[JointMotion]:
    """Return the motion of each joint along all segments of the logs.

    The arm is rigid, and gravity acts on it. ``zeros`` (n,) are offsets of the logged angles [rad].
    """
    parts = [(logs[k], s) for k, s in segments(logs)]
    torques = [_torques(arm, log.t[s], log.q[s] - zeros) for log, s in parts]
    t = [log.t[s] for log, s in parts]
    bounds = np.concatenate([[0], np.cumsum([len(x) for x in t])])
    out = []
    for j in range(arm.n):
        commands = [log.q_cmd[s, j] for log, s in parts]
        nodes = [
            command_nodes(x, command, x[0] - OUTSIDE, x[-1] + OUTSIDE)
            for x, command in zip(t, commands, strict=True)
        ]
        gravity, slope, inertia, coupling = (
            np.concatenate([x[i][:, j] for x in torques]) for i in range(4)
        )
        out.append(
            JointMotion(
                t=np.concatenate(t),
                q=np.concatenate([log.q[s, j] for log, s in parts]),
                command=np.concatenate(commands),
                bounds=bounds,
                nodes=np.concatenate(nodes, axis=1),
                gravity=gravity,
                slope=slope,
                inertia=inertia,
                coupling=coupling,
            )
        )
    return out


def _torques(arm: Arm, t: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return gravity, its slope, diagonal inertia, coupling torque along one segment, (T, n)."""
    model = arm.model()
    data = mujoco.MjData(model)
    n = arm.n
    smooth = lowpass(q, 1.0 / float(np.median(np.diff(t))), CUTOFF_HZ)
    speed = np.gradient(smooth, t, axis=0)
    acceleration = np.gradient(speed, t, axis=0)
    gravity, slope, inertia, coupling = (np.empty((len(t), n)) for _ in range(4))
    mass = np.empty((n, n))
    for k in range(len(t)):
        data.qpos[:], data.qvel[:] = q[k], speed[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        bias = data.qfrc_bias.copy()
        data.qvel[:] = 0.0
        gravity[k] = _gravity(model, data)
        inertia[k] = np.diag(mass)
        coupling[k] = bias - gravity[k] + mass @ acceleration[k] - inertia[k] * acceleration[k]
        for j in range(n):
            data.qpos[j] += TILT
            slope[k, j] = (_gravity(model, data)[j] - gravity[k, j]) / TILT
            data.qpos[j] = q[k, j]
    return gravity, slope, inertia, coupling


def _gravity(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the (n,) gravity torque at rest at ``data.qpos`` [N·m]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)  # at rest: what the last speeds left would count
    out = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, out)
    return out
