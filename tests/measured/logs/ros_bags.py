"""Recordings of ROS with the joint states of a log, written through rosbags, no ROS needed."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

Array = np.ndarray
START = 1_700_000_000_123_456_789
"""Date of the first message [ns]: a float of seconds would round it by 100 ns."""
PANDA = tuple(f"panda_joint{j}" for j in range(1, 8))
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
STORES = {"ros1": Stores.ROS1_NOETIC, "ros2": Stores.ROS2_HUMBLE}
KINDS = ("bag", "mcap", "db3", "folder")

FRANKA_STATE_1 = """std_msgs/Header header
float64[7] q
float64[7] dq
float64[7] tau_J
float64[7] tau_J_d
"""
FRANKA_STATE_2 = FRANKA_STATE_1.replace("tau_J", "tau_j")
FRANKA_ROBOT_STATE = """std_msgs/Header header
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
"""
LBR_STATE = """float64 sample_time
uint32 time_stamp_sec
uint32 time_stamp_nano_sec
float64[7] measured_joint_position
float64[7] measured_torque
float64[7] commanded_torque
float64[7] external_torque
"""
LBR_STATE_OLD = """float64 sample_time
uint32 time_stamp_sec
uint32 time_stamp_nano_sec
float64[] measured_joint_position
float64[] torque
float64[] external_torque
"""
CONTROLLER_STATE = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint {}
trajectory_msgs/JointTrajectoryPoint {}
trajectory_msgs/JointTrajectoryPoint error
"""
IIWA_AXES = "".join(f"float32 a{j}\n" for j in range(1, 8))
"""Fields of iiwa_msgs: one number a joint."""
_STATE = "control_msgs/msg/JointTrajectoryControllerState"
OWN_TYPES = {
    "ros1": {
        _STATE: CONTROLLER_STATE.format("desired", "actual"),
        "franka_msgs/msg/FrankaState": FRANKA_STATE_1,
        "iiwa_msgs/msg/JointQuantity": IIWA_AXES,
        **{
            f"iiwa_msgs/msg/Joint{x}": f"Header header\nJointQuantity {x.lower()}\n"
            for x in ("Position", "Torque", "Velocity")
        },
    },
    "ros2": {
        _STATE: CONTROLLER_STATE.format("reference", "feedback"),
        "franka_msgs/msg/FrankaState": FRANKA_STATE_2,
        "franka_msgs/msg/FrankaRobotState": FRANKA_ROBOT_STATE,
        "lbr_fri_idl/msg/LBRState": LBR_STATE,
        "lbr_fri_msgs/msg/LBRState": LBR_STATE_OLD,
    },
}
"""Fields of these messages that are read, and those beside them that must not be."""


@dataclass
class Message:
    topic: str
    type: str
    time: int
    """Time of recording [ns]."""
    fields: dict[str, Any]


def store(ros: str) -> Typestore:
    """Return what rosbags knows of a ROS, with the types of robots."""
    known = get_typestore(STORES[ros])
    for name, text in OWN_TYPES[ros].items():
        known.register(get_types_from_msg(text, name))
    return known


def header(known: Typestore, time: int, number: int = 0) -> Any:
    """Return a header with a stamp [ns]."""
    stamp = known.types["builtin_interfaces/msg/Time"](*divmod(time, 10**9))
    of = known.types["std_msgs/msg/Header"]
    if "seq" in of.__dataclass_fields__:
        return of(seq=number, stamp=stamp, frame_id="")
    return of(stamp=stamp, frame_id="")


def write_bag(
    path: Path, kind: str, messages: Iterable[Message], *, silent: Mapping[str, str] | None = None
) -> Path:
    """Write a bag of one of `KINDS`; return its file or folder.

    ``silent`` are types of topics without messages.
    """
    ros = "ros1" if kind == "bag" else "ros2"
    known = store(ros)
    if kind == "bag":
        made = path.with_suffix(".bag")
        writer: Any = rosbag1.Writer(made)
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        made = path if kind == "folder" else path / f"{path.name}.{kind}"
    code = known.serialize_ros1 if kind == "bag" else known.serialize_cdr
    with writer:
        connections = {
            topic: writer.add_connection(topic, of, typestore=known)
            for topic, of in (silent or {}).items()
        }
        for number, m in enumerate(messages):
            if m.topic not in connections:
                connections[m.topic] = writer.add_connection(m.topic, m.type, typestore=known)
            fields = {
                k: v(known, m.time, number) if callable(v) else v for k, v in m.fields.items()
            }
            writer.write(connections[m.topic], m.time, code(known.types[m.type](**fields), m.type))
    return made


def joint_states(
    values: Array,
    names: tuple[str, ...] = PANDA,
    *,
    topic: str = "/joint_states",
    stamp: Callable[..., Any] = header,
    speeds: bool = True,
    efforts: bool = True,
) -> list[Message]:
    """Return ``t, q, dq, tau`` (T, 1 + 3n) as messages; their joints in another order each time."""
    rng = np.random.default_rng(0)

    def fields(channels: Array) -> dict[str, Any]:
        order = rng.permutation(len(names))
        q, dq, tau = (np.ascontiguousarray(x[order]) for x in channels)
        return {
            "header": stamp,
            "name": [names[k] for k in order],
            "position": q,
            "velocity": dq if speeds else np.zeros(0),
            "effort": tau if efforts else np.zeros(0),
        }

    return states(values, topic, "sensor_msgs/msg/JointState", fields)


def states(
    values: Array, topic: str, kind: str, fields: Callable[[Array], dict[str, Any]]
) -> list[Message]:
    """Return a message for each row (T, 1 + 3n); ``fields`` make its fields from ``q, dq, tau``."""
    return [
        Message(topic, kind, START + round(row[0] * 1e9), fields(row[1:].reshape(3, -1)))
        for row in values
    ]


def merged(*streams: list[Message]) -> list[Message]:
    return sorted((m for s in streams for m in s), key=lambda m: m.time)
