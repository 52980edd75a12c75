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

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

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
    q_cmd: Array
    """Commanded angles [rad]; empty where it has none."""


@dataclass(frozen=True)
class Kind:
    """A type of message, and the paths of its fields; where versions differ, both, ``new|old``."""

    types: tuple[str, ...]
    q: str
    dq: str = ""
    tau: str = ""
    q_cmd: str = ""
    names: str = ""
    stamp: tuple[str, ...] = ("header.stamp.sec", "header.stamp.nanosec")
    """Seconds and nanoseconds; () where it has none."""
    link_side: bool = False
    """Whether the torque is always measured behind the gear."""

    @property
    def torque(self) -> str:
        """Name of the field that is read as torque."""
        return self.tau.partition("|")[0]

    def read(self, message: Message) -> Sample:
        """Return the state in a message."""
        sec, nanosec = [int(_field(message, x)) for x in self.stamp] or [0, 0]
        return Sample(
            tuple(_field(message, self.names)) or None,
            sec * 10**9 + nanosec,
            *(_array(_field(message, x)) for x in (self.q, self.dq, self.tau, self.q_cmd)),
        )


def side_of(kind: Kind, names: Sequence[str]) -> str | None:
    """Return the side of the gear on which torque was measured, where type or names say it."""
    named = bool(names) and all(LINK_SIDE.match(x) for x in names)
    return "link" if kind.link_side or named else None


def _field(message: Message, paths: str) -> Any:
    """Return the field of the first path that a message has; nothing for no path."""
    for path in filter(None, paths.split("|")):
        with suppress(AttributeError):
            return attrgetter(path)(message)
    if paths:
        raise AttributeError(f"no field {paths}")
    return ()


def _array(values: Any) -> Array:
    if hasattr(values, "a1"):  # KUKA's axes
        values = [getattr(values, f"a{j}") for j in range(1, 8)]
    return np.asarray(values, np.float64).reshape(-1)


KINDS = (
    Kind((_STATE,), "position", "velocity", "effort", names="name"),
    Kind(("franka_msgs/msg/FrankaState",), "q", "dq", "tau_J|tau_j", link_side=True),
    Kind(
        ("franka_msgs/msg/FrankaRobotState",),
        "measured_joint_state.position",
        "measured_joint_state.velocity",
        "measured_joint_state.effort",
        names="measured_joint_state.name",
        link_side=True,
    ),
    Kind(
        ("lbr_fri_idl/msg/LBRState", "lbr_fri_msgs/msg/LBRState"),
        "measured_joint_position",
        tau="measured_torque|torque",
        stamp=("time_stamp_sec", "time_stamp_nano_sec"),
        link_side=True,
    ),
    Kind(
        ("control_msgs/msg/JointTrajectoryControllerState",),
        "feedback.positions|actual.positions",
        "feedback.velocities|actual.velocities",
        "feedback.effort|actual.effort",
        "reference.positions|desired.positions",
        names="joint_names",
    ),
)

BY_TYPE = {name: kind for kind in KINDS for name in kind.types}
COMMAND_KINDS = {_STATE: BY_TYPE[_STATE], _ARRAY: Kind((_ARRAY,), "data", stamp=())}
"""Types of commands under a topic of their own."""
IIWA = Kind(IIWA_TYPES, "position|velocity|torque", link_side=True)
"""One quantity of an arm of iiwa_stack, whatever it is."""


def is_command(topic: str, kind: str) -> bool:
    """Return whether a topic has commanded angles, by its name and type."""
    named = COMMANDS.search(topic) and not _NO_POSITION.search(topic)
    return kind in COMMAND_KINDS and bool(named)
