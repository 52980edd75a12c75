"""Messages of ROS with the state of an arm's joints: our name of each field.

| type | ``q``, ``dq`` | ``tau`` |
|---|---|---|
| ``sensor_msgs/JointState`` | ``position``, ``velocity`` | ``effort`` |
| ``franka_msgs/FrankaState`` | ``q``, ``dq`` | ``tau_J`` (in ROS 2 ``tau_j``) |
| ``franka_msgs/FrankaRobotState`` | of its ``measured_joint_state`` | ``effort`` there: tau_J |
| ``lbr_fri_idl/LBRState`` | ``measured_joint_position``, none | ``measured_torque`` |
| ``control_msgs/JointTrajectoryControllerState`` | of its ``feedback`` | ``effort`` there |

The last has ``q_cmd`` too, of its ``reference`` (of old: ``actual`` and ``desired``). Else commands
are a ``JointState`` or a ``std_msgs/Float64MultiArray`` under a topic of their own (`is_command`).

The `LBRState` of the first ``lbr_fri_msgs`` calls that ``torque``. Time is ``header.stamp``, of an
``LBRState`` that of KUKA's controller.
tau_J and the measured torque of KUKA's FRI are measured behind the gear and hold gravity; commanded
torques (``tau_J_d``, ``commanded_torque``) do not, and are not read. franka_ros, franka_ros2,
iiwa_ros and the LBR-Stack publish the same torques as the efforts of a ``JointState``; those of
other arms may be currents or motor torques: see their driver.

Sources: common_interfaces, franka_ros, franka_ros2, lbr_fri_ros2_stack (their .msg files);
iiwa_ros, iiwa_driver/src/iiwa.cpp; control_msgs, JointTrajectoryControllerState.msg.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array

Message = Any
"""A message of ROS, or a part of one: rosbags makes their classes at run time."""

LINK_SIDE = re.compile(r"(panda|fr3|fp3|lbr|iiwa)\d*_?")
"""Names of joints of Franka's and KUKA's arms, whose torques are measured behind the gear."""
COMMANDS = re.compile(r"command|cmd|target|goal|reference|desired")
"""In the names of topics with commands."""
IIWA_TYPES = tuple(f"iiwa_msgs/msg/Joint{x}" for x in ("Position", "Velocity", "Torque"))
_NO_POSITION = re.compile(r"effort|torque|vel|current|gain|gripper")
_ARRAY, _STATE = "std_msgs/msg/Float64MultiArray", "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Sample:
    """State of some joints at one time."""

    names: tuple[str, ...] | None
    """Names of the joints; None where the message has the joints in the arm's order."""
    stamp: int
    """Time [ns]; 0 where it has none."""
    q: Array
    """Angles [rad]."""
    dq: Array
    """Speeds [rad/s]; empty where it has none."""
    tau: Array
    """Torques [N·m]; empty where it has none."""
    q_cmd: Array = field(default_factory=lambda: np.zeros(0))
    """Commanded angles [rad]; empty where it has none."""


@dataclass(frozen=True)
class Kind:
    """A type of message."""

    types: tuple[str, ...]
    tau: str
    """The field that is read as torque."""
    read: Callable[[Message], Sample]
    link_side: bool = False
    """Whether the torque is always measured behind the gear."""
    has_commands: bool = False


def side_of(kind: Kind, names: Sequence[str]) -> str | None:
    """Return the side of the gear on which torque was measured, where type or names say it."""
    named = bool(names) and all(LINK_SIDE.match(x) for x in names)
    return "link" if kind.link_side or named else None


def _stamp(header: Message) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def _array(values: ArrayLike) -> Array:
    return np.asarray(values, np.float64).reshape(-1)


def _joint_state(message: Message) -> Sample:
    return Sample(
        tuple(message.name) or None,
        _stamp(message.header),
        _array(message.position),
        _array(message.velocity),
        _array(message.effort),
    )


def _franka_state(message: Message) -> Sample:
    tau = message.tau_J if hasattr(message, "tau_J") else message.tau_j
    return Sample(None, _stamp(message.header), _array(message.q), _array(message.dq), _array(tau))


def _franka_robot_state(message: Message) -> Sample:
    of = _joint_state(message.measured_joint_state)
    return Sample(of.names, _stamp(message.header), of.q, of.dq, of.tau)


def _controller_state(message: Message) -> Sample:
    state = message.feedback if hasattr(message, "feedback") else message.actual
    told = message.reference if hasattr(message, "reference") else message.desired
    return Sample(
        tuple(message.joint_names) or None,
        _stamp(message.header),
        _array(state.positions),
        _array(state.velocities),
        _array(state.effort),
        _array(told.positions),
    )


def _command(message: Message) -> Sample:
    return Sample(None, 0, _array(message.data), np.zeros(0), np.zeros(0))


def _lbr_state(message: Message) -> Sample:
    tau = message.measured_torque if hasattr(message, "measured_torque") else message.torque
    stamp = int(message.time_stamp_sec) * 10**9 + int(message.time_stamp_nano_sec)
    return Sample(None, stamp, _array(message.measured_joint_position), np.zeros(0), _array(tau))


def _iiwa(message: Message) -> Sample:
    fields = ("position", "velocity", "torque")
    axes = next(getattr(message, x) for x in fields if hasattr(message, x))
    values = [getattr(axes, f"a{j}") for j in range(1, 8)]
    return Sample(None, _stamp(message.header), _array(values), np.zeros(0), np.zeros(0))


KINDS = (
    Kind((_STATE,), "effort", _joint_state),
    Kind(("franka_msgs/msg/FrankaState",), "tau_J", _franka_state, link_side=True),
    Kind(
        ("franka_msgs/msg/FrankaRobotState",),
        "measured_joint_state.effort",
        _franka_robot_state,
        link_side=True,
    ),
    Kind(
        ("lbr_fri_idl/msg/LBRState", "lbr_fri_msgs/msg/LBRState"),
        "measured_torque",
        _lbr_state,
        link_side=True,
    ),
    Kind(
        ("control_msgs/msg/JointTrajectoryControllerState",),
        "feedback.effort",
        _controller_state,
        has_commands=True,
    ),
)

BY_TYPE = {name: kind for kind in KINDS for name in kind.types}
COMMAND_KINDS = {_STATE: BY_TYPE[_STATE], _ARRAY: Kind((_ARRAY,), "", _command)}
"""Types of commands under a topic of their own."""
IIWA = Kind(IIWA_TYPES, "", _iiwa, link_side=True)
"""One quantity of an arm, whatever it is (`iiwa_stack`)."""


def is_command(topic: str, kind: str) -> bool:
    """Return whether a topic has commanded angles, by its name and type."""
    named = COMMANDS.search(topic) and not _NO_POSITION.search(topic)
    return kind in COMMAND_KINDS and bool(named)
