"""A diagnosis as MCAP with messages of ROS 2, which Foxglove and PlotJuggler open.

| topic | type | what |
|---|---|---|
| ``/measured`` | JointState | angles, speeds where known, torques of joint logs |
| ``/commanded`` | JointState | angles of servo logs |
| ``/nominal``, ``/simulated`` | JointState | torques or angles of the model judged, and extended |
| ``/nominal_residual``, ``/residual`` | JointState | measured less those |
| ``/cause/NAME`` | JointState | torque that a cause adds |
| ``/contact`` | Bool | of servo logs |
| ``/diagnosis`` | String | verdict and evidence |

Every stamp is the date of the row, or its time where logs have no date.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import missing_extra
from stiction_envs.gap.viewers.series import Series

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer
    from rosbags.typesys.store import Typestore

Array = NDArray[np.float64]
JOINT_STATE, BOOL, STRING = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Bool",
    "std_msgs/msg/String",
)
FIELDS = ("position", "velocity", "effort")
NONE = np.zeros(0)


def check_package() -> None:
    """Raise if rosbags is not installed."""
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise missing_extra("writing MCAP", "rosbags", "ros") from None


def topics(s: Series) -> dict[str, dict[str, Array]]:
    """Return the channels of JointState by topic: ``position``, ``velocity``, ``effort``."""
    field = "effort" if s.quantity == "torque" else "position"
    measured = {"position": s.q} | ({} if s.dq is None else {"velocity": s.dq})
    out = {"/measured": measured | {field: s.measured}}
    if s.q_cmd is not None:
        out["/commanded"] = {"position": s.q_cmd}
    for name, values in (("nominal", s.nominal), ("simulated", s.simulated)):
        out[f"/{name}"] = {field: values}
        residual = "/residual" if name == "simulated" else "/nominal_residual"
        out[residual] = {field: s.measured - values}
    return out | {f"/cause/{name}": {"effort": torque} for name, torque in s.causes.items()}


def stamps(s: Series) -> list[int]:
    """Return the time of each row [ns]; none before 1970."""
    whole = round(s.date * 1e9)
    time = np.rint(1e9 * (s.time - min(0.0, s.time[0] if not whole else 0.0)))
    return [whole + int(x) for x in time]


def mcap_bytes(s: Series) -> bytes:
    """Return the file."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    known = get_typestore(Stores.ROS2_JAZZY)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "diagnosis"
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            _write(s, writer, known)
        return (path / "diagnosis.mcap").read_bytes()


def _write(s: Series, writer: Writer, known: Typestore) -> None:
    """Write all messages in the order of their time."""
    joint_state, header, stamp = (
        known.types[x] for x in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    names = list(s.arm.joint_names)

    def connect(topic: str, kind: str) -> Connection:
        return writer.add_connection(topic, kind, typestore=known)

    def send(connection: Connection, time: int, message: object) -> None:
        writer.write(connection, time, known.serialize_cdr(message, connection.msgtype))

    of = topics(s)
    said = connect("/diagnosis", STRING)
    connections = {topic: connect(topic, JOINT_STATE) for topic in of}
    touches = None if s.contact is None else connect("/contact", BOOL)
    for k, time in enumerate(stamps(s)):
        if k == 0:
            send(said, time, known.types[STRING](data=s.text))
        at = header(stamp=stamp(*divmod(time, 10**9)), frame_id="")
        for topic, channels in of.items():
            row = {
                f: np.ascontiguousarray(channels[f][k]) if f in channels else NONE for f in FIELDS
            }
            send(connections[topic], time, joint_state(header=at, name=names, **row))
        if touches is not None and s.contact is not None:
            send(touches, time, known.types[BOOL](data=bool(s.contact[k])))
