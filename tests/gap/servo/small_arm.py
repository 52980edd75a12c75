"""An arm of two links under gravity, and motions of one joint, for fast tests."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion, command_nodes
from stiction_envs.gap.servo.servo_parameters import INDEX, absent
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
TWO_LINKS = """<mujoco model="two_links"><compiler angle="radian"/><worldbody>
<body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" range="-2.5 2.5"/>
<inertial pos="0.15 0 0" mass="1.0" diaginertia="0.002 0.01 0.01"/>
<body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" range="-2.5 2.5"/>
<inertial pos="0.1 0 0" mass="0.6" diaginertia="0.001 0.004 0.004"/>
</body></body></worldbody></mujoco>"""


def two_links(folder: Path, *, payload: Sequence[float] | None = None) -> Arm:
    """Return the arm, written into a folder."""
    path = folder / "two_links.xml"
    path.write_text(TWO_LINKS)
    return load_arm(path, payload=payload)


def motion(
    command: Array,
    *,
    step: float = 0.01,
    q: Array | None = None,
    gravity: float = 0.0,
    slope: float = 0.0,
    inertia: float = 0.02,
) -> JointMotion:
    """Return a joint alone that is told (T,) angles [rad]; ``q`` was measured, else the command."""
    t = step * np.arange(len(command))
    measured = command if q is None else q
    return JointMotion(
        t=t,
        q=measured,
        bounds=np.array([0, len(t)]),
        command=command,
        nodes=command_nodes(t, command, t[0] - 1.0, t[-1] + 1.0),
        gravity=np.full(len(t), gravity) + slope * measured,
        slope=np.full(len(t), slope),
        inertia=np.full(len(t), inertia),
        coupling=np.zeros(len(t)),
    )


def held(log: ServoLog, begin: float, end: float) -> tuple[ServoLog, NDArray[np.bool_]]:
    """Return a log whose second joint stands for a while [s], told to go on, and those rows."""
    q, command = log.q.copy(), log.q_cmd.copy()
    stop = (log.t > begin) & (log.t < end)
    command[stop, 1] += 1.2
    q[stop, 1] = q[np.flatnonzero(stop)[0], 1]
    return replace(log, source="held.csv", q=q, q_cmd=command), stop


def parameters(**values: float) -> Array:
    """Return (P,) parameters of a joint with a servo of 20 N·m/rad; others by name."""
    out = absent()
    out[INDEX["stiffness"]] = 20.0
    for name, value in values.items():
        out[INDEX[name]] = value
    return out
