"""Bags of iiwa_stack (ROS 1): an arm's positions, speeds and torques under topics of their own.

| topic | becomes |
|---|---|
| ``NAME/state/JointPosition`` (``iiwa_msgs/JointPosition``) | ``q``, and the time of the rows |
| ``NAME/state/JointTorque``, ``NAME/state/JointVelocity`` | ``tau`` behind the gear, ``dq`` |
| ``NAME/command/JointPosition`` | ``q_cmd``, which holds until the next one |

Torques and speeds with other stamps are interpolated, but not over a gap.
``ExternalJointTorque`` is what the controller makes of torques and model, and is not read.
Source: IFL-CAMP/iiwa_stack, iiwa_msgs/msg, iiwa_ros/src/state.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.formats.base import RawLog, Wanted, check_size, held
from stiction_envs.measured.logs.formats.messages import Message

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

JOINTS = tuple(f"a{j}" for j in range(1, 8))
"""Fields of a message, one a joint."""
MOST_STEPS = 5.0  # torques further apart than this many usual steps are a gap; assumed
_NS = 10**9
_TYPE = "iiwa_msgs/msg/Joint"
_STATE, _COMMAND = "/state/Joint", "/command/Joint"


@dataclass
class Stream:
    """One topic: stamps (T,) [ns] and values (T, 7)."""

    stamps: Index
    values: Array


def arms(types: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return topics by the name of their arm and channel, of all topics with their types."""
    found: dict[str, dict[str, str]] = {}
    for topic, kind in types.items():
        quantity = kind.removeprefix(_TYPE)
        for part, channels in (
            (_STATE, {"Position": "q", "Torque": "tau", "Velocity": "dq"}),
            (_COMMAND, {"Position": "q_cmd"}),
        ):
            name, between, end = topic.partition(part)
            if kind.startswith(_TYPE) and between and end == quantity and quantity in channels:
                found.setdefault(name, {})[channels[quantity]] = topic
    return {name: topics for name, topics in found.items() if "q" in topics}


def arm_of(where: str, found: dict[str, dict[str, str]], topic: str | None) -> dict[str, str]:
    """Return the topics of the only arm, or of that which has a topic."""
    if topic is not None:
        names = {t: name for name, topics in found.items() for t in topics.values()}
        if topic not in names:
            raise StictionError(f"{where}: {unknown('topic', topic, names)}")
        return found[names[topic]]
    if len(found) > 1:
        states = ", ".join(topics["q"] for topics in found.values())
        raise StictionError(
            f"{where}: several arms: {states}: expected one; name a topic of the arm"
        )
    return next(iter(found.values()))


def read_arm(where: str, reader: AnyReader, topics: Mapping[str, str], wanted: Wanted) -> RawLog:
    """Read an arm's topics as one log."""
    if wanted.n_joints != len(JOINTS):
        raise StictionError(
            f"{where}: iiwa_stack's arm has 7 joints, but the robot has {wanted.n_joints}: "
            "expected a log of it"
        )
    for drive, channel, name in (
        (TORQUE, "tau", "state/JointTorque"),
        (POSITION, "q_cmd", "command/JointPosition"),
    ):
        if wanted.drive == drive and channel not in topics:
            raise StictionError(f"{where}: no topic {name}: expected it beside {topics['q']}")
    used = {k: v for k, v in topics.items() if k != "q_cmd" or wanted.drive == POSITION}
    streams = {k: _stream(where, reader, topic) for k, topic in used.items()}
    empty = [k for k, s in streams.items() if not len(s.stamps)]
    for k in empty:
        if k == "dq":
            del streams[k]
        else:
            raise StictionError(f"{where}, {used[k]}: no messages: expected one second")
    q = streams.pop("q")
    keep = np.ones(len(q.stamps), bool)
    data = {"q": q.values}
    for k, stream in streams.items():
        if k == "q_cmd":
            last, there = held(stream.stamps, q.stamps)
            data[k] = stream.values[last]
        else:
            data[k], there = _interpolated(q.stamps, stream)
        keep &= there
    rows, first = np.flatnonzero(keep), int(q.stamps[0])
    t = (q.stamps[keep] - first) / _NS
    log = RawLog(
        source=where,
        t=t if wanted.time else np.arange(float(len(rows))),
        data={k: np.ascontiguousarray(x[keep]) for k, x in data.items()},
        run=np.zeros(len(rows), np.int64),
        place=lambda i: f"{where}, {topics['q']}, message {rows[i] + 1}",
        side="link",
        origin=first / _NS,
    )
    text = f"iiwa_stack: {', '.join(used.values())}; tau is measured behind the gear"
    log.note(text)
    return log


def _interpolated(stamps: Index, stream: Stream) -> tuple[Array, Bools]:
    """Return values (T, 7) at stamps (T,) [ns], and where there are some on both sides."""
    # float of seconds since 1970 would round by 100 ns
    first = stream.stamps[0]
    at, known = (stamps - first).astype(float), (stream.stamps - first).astype(float)
    values = np.stack([np.interp(at, known, x) for x in stream.values.T], axis=1)
    right = np.searchsorted(known, at, side="left").clip(0, len(known) - 1)
    left = (np.searchsorted(known, at, side="right") - 1).clip(0)
    step = np.median(np.diff(known)) if len(known) > 1 else 0.0
    there = (at >= known[0]) & (at <= known[-1])
    return values, there & (known[right] - known[left] <= MOST_STEPS * step)


def _stream(where: str, reader: AnyReader, topic: str) -> Stream:
    connections = [c for c in reader.connections if c.topic == topic]
    stamps, times, values = array("q"), array("q"), array("d")
    for connection, time, raw in reader.messages(connections=connections):
        message: Message = reader.deserialize(raw, connection.msgtype)
        axes = getattr(message, topic.rpartition("Joint")[2].lower())
        values.extend(float(getattr(axes, a)) for a in JOINTS)
        stamps.append(int(message.header.stamp.sec) * _NS + int(message.header.stamp.nanosec))
        times.append(time)
        check_size(f"{where}, {topic}", len(times), 1 + len(JOINTS))
    chosen = np.array(stamps if any(stamps) else times, np.int64)
    rows = np.array(values, np.float64).reshape(-1, len(JOINTS))
    order = np.argsort(chosen, kind="stable")
    return Stream(chosen[order], rows[order])
