"""ROS bags: ROS 1 ``.bag``, ROS 2 ``.mcap`` and ``.db3``, or the folder that ROS 2 records into.

Read with `rosbags`, which needs no ROS. One topic is read: the only one with states of so many
joints and torques, or the one asked for. Messages with none of the arm's joints (a gripper that
publishes to the same topic) are left out. A message with only some of them is an error: the
others are then unknown. Commanded positions are those of a trajectory controller's state, else of
a topic of commands beside the states, and hold until the next one. Bags of iiwa_stack (ROS 1) have
a topic for each quantity; torques and speeds with other stamps are interpolated, but not over a
gap:

| topic | becomes |
|---|---|
| ``NAME/state/JointPosition`` (``iiwa_msgs/JointPosition``) | ``q``, and the time of the rows |
| ``NAME/state/JointTorque``, ``NAME/state/JointVelocity`` | ``tau`` behind the gear, ``dq`` |
| ``NAME/command/JointPosition`` | ``q_cmd`` |

``ExternalJointTorque`` is what the controller makes of torques and model, and is not read.
Source: IFL-CAMP/iiwa_stack, iiwa_msgs/msg, iiwa_ros/src/state.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError, missing_extra, unknown
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.formats.base import LogFormat, RawLog, Wanted, check_size, held
from stiction_envs.measured.logs.formats.messages import (
    BY_TYPE,
    COMMAND_KINDS,
    IIWA,
    Kind,
    Sample,
    is_command,
    side_of,
)
from stiction_envs.measured.logs.joint_names import Naming, find_joints

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

_PEEK = 1000  # messages that show who publishes to a topic; assumed
MOST_REASON = 200  # most characters of another library's message, cut between words; assumed
MOST_STEPS = 5.0  # torques further apart than this many usual steps are a gap; assumed
_NS = 10**9
_IIWA_TOPICS = {
    "/state/Joint": {"Position": "q", "Torque": "tau", "Velocity": "dq"},
    "/command/Joint": {"Position": "q_cmd"},
}


class RosBag(LogFormat):
    """A recording of ROS."""

    ends: ClassVar = (".bag", ".mcap", ".db3")
    inside: ClassVar = ("metadata.yaml",)

    def read(self, where: str, wanted: Wanted) -> RawLog:
        with _open(where) as reader:
            return _read(where, reader, wanted)

    def names(self, where: str, naming: Naming) -> list[str]:
        with _open(where) as reader:
            if topics := _iiwa_stack(where, reader, naming):
                return [f"{channel}7" for channel in topics]
            marks, n = _marks(reader), len(naming.robot) or None
            topic, kind = _topic(
                where, reader, n, naming, POSITION if marks == ["q_cmd1"] else TORQUE
            )
            names, most, _ = _peek(reader, topic, kind)
        found = len(find_joints(where, names, n, naming)) if names else most
        return [*(f"q{j + 1}" for j in range(found)), *marks]


@dataclass
class _Stream:
    """Messages of one topic with the arm's joints."""

    topic: str
    kind: Kind
    joints: tuple[str, ...]
    """Names of joints 1 to n; () where the messages have none."""
    marks: Index
    """(T, 3) stamp, 0 where there is none, and time of recording [ns]; number from 1."""
    data: dict[str, Array]
    """(T, n) by channel."""
    others: int

    def keep(self, rows: Bools) -> None:
        """Drop the other rows."""
        self.data = {k: np.ascontiguousarray(x[rows]) for k, x in self.data.items()}
        self.marks = self.marks[rows]


def _iiwa_stack(where: str, reader: AnyReader, naming: Naming) -> dict[str, str]:
    """Return the topics of iiwa_stack's arm, by channel; none where other states are there."""
    arms: dict[str, dict[str, str]] = {}
    filled = [c for c in reader.connections if c.msgcount]
    for c in filled:
        quantity = str(c.msgtype).removeprefix("iiwa_msgs/msg/Joint")
        for part, channels in _IIWA_TOPICS.items():
            name, _, end = c.topic.partition(part)
            if quantity in channels and end == quantity:
                arms.setdefault(name, {})[channels[quantity]] = c.topic
    arms = {name: topics for name, topics in arms.items() if "q" in topics}
    for topics in arms.values():
        if naming.topic in topics.values():
            return topics
    if naming.topic is not None or any(c.msgtype in BY_TYPE for c in filled):
        return {}
    if len(arms) > 1:
        states = ", ".join(topics["q"] for topics in arms.values())
        raise StictionError(
            f"{where}: several arms: {states}: expected one; name a topic of the arm"
        )
    return next(iter(arms.values()), {})


@contextmanager
def _open(where: str) -> Iterator[AnyReader]:
    """Open a bag; any failure while it is open becomes one error."""
    try:
        from rosbags.highlevel import AnyReader  # here: few logs need it, and it takes a moment
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing_extra(f"{where}: reading a ROS bag", "rosbags", "ros") from None
    for file in (x for x in Path(where).glob("*") if x.suffix in RosBag.ends):
        refuse_pointer(file)
    try:
        # for bags that do not describe their messages themselves, as older ones of ROS 2
        known = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([Path(where)], default_typestore=known) as reader:
            yield reader
    except StictionError:
        raise
    except Exception as error:
        # damaged bags raise almost anything, from struct.error to apsw's and zstd's own
        reason = shorten(str(error).replace(where, ""), MOST_REASON, placeholder=" …")
        raise StictionError(
            f"{where}: damaged or no ROS bag ({type(error).__name__}: {reason}): expected a whole "
            ".bag, .mcap, .db3 or folder of ROS 2; a recorder that was killed leaves one that "
            "`rosbag reindex`, `ros2 bag reindex` or `mcap recover` repairs"
        ) from None


def _samples(reader: AnyReader, topic: str, kind: Kind) -> Iterator[tuple[int, Sample]]:
    """Return the messages of a topic with the time of their recording [ns]."""
    connections = [c for c in reader.connections if c.topic == topic and c.msgtype in kind.types]
    for connection, time, data in reader.messages(connections=connections):
        yield time, kind.read(reader.deserialize(data, connection.msgtype))


def _peek(reader: AnyReader, topic: str, kind: Kind) -> tuple[list[str], int, bool]:
    """Return joints that the first messages of a topic name, how many, whether it has torques."""
    names: dict[str, None] = {}
    most, torques = 0, False
    for _, sample in islice(_samples(reader, topic, kind), _PEEK):
        names |= dict.fromkeys(sample.names or ())
        most = max(most, len(sample.q))
        torques |= bool(np.isfinite(sample.tau).any())
    return list(names), most, torques


def _marks(reader: AnyReader) -> list[str]:
    """Return columns of the possible drives; torque's if unknown: its reader then raises."""
    known = _topics(reader, BY_TYPE, commands=False)
    torque = any(_peek(reader, k, v)[2] for k, v in known.items())
    position = any(x.q_cmd for x in known.values())
    position = position or bool(_topics(reader, COMMAND_KINDS, commands=True))
    return [x for x, has in (("tau1", torque), ("q_cmd1", position)) if has] or ["tau1"]


def _topics(reader: AnyReader, kinds: Mapping[str, Kind], *, commands: bool) -> dict[str, Kind]:
    """Return the topics of some kinds that have messages: those of commands, or the others."""
    types = {c.topic: str(c.msgtype) for c in reader.connections if c.msgcount}
    found = {k: kinds[v] for k, v in types.items() if v in kinds}
    return {k: v for k, v in found.items() if is_command(k, types[k]) == commands}


def _topic(
    where: str, reader: AnyReader, n_joints: int | None, naming: Naming, drive: str = TORQUE
) -> tuple[str, Kind]:
    """Return the topic with the arm's states: where torque drives, with torques."""
    types = {c.topic: str(c.msgtype) for c in reader.connections}
    known = {k: BY_TYPE[v] for k, v in types.items() if v in BY_TYPE}
    if naming.topic is not None:
        if naming.topic not in types:
            raise StictionError(f"{where}: {unknown('topic', naming.topic, known or types)}")
        types = {naming.topic: types[naming.topic]}
        known = {k: v for k, v in known.items() if k in types}
    if not known:
        shown = ", ".join(f"{k} ({v})" for k, v in islice(types.items(), 5)) or "none"
        more = f" and {len(types) - 5} more" if len(types) > 5 else ""
        raise StictionError(
            f"{where}: no joint states; its topics are {shown}{more}: expected one of "
            f"{', '.join(BY_TYPE)}"
        )
    for topic in known:
        if types[topic] not in reader.typestore.fielddefs:
            raise StictionError(
                f"{where}, {topic}: the bag does not describe {types[topic]}: expected one of "
                "sensor_msgs/msg/JointState, or a bag recorded with ROS 2 Iron or later"
            )
    said = {c.topic for c in reader.connections if c.msgcount}
    filled = {k: v for k, v in known.items() if k in said}
    if not filled:
        raise StictionError(f"{where}, {next(iter(known))}: no messages: expected one second")
    for prefer in (
        {k for k in filled if not is_command(k, types[k])},
        {k for k, v in filled.items() if bool(v.q_cmd) == (drive == POSITION)},
    ):
        filled = {k: v for k, v in filled.items() if k in prefer} or filled
    if len(filled) == 1:
        return next(iter(filled.items()))
    seen = {k: _peek(reader, k, v) for k, v in filled.items()}
    sizes = {k: len(names) or n for k, (names, n, tau) in seen.items() if tau or drive == POSITION}
    least = n_joints or max(1, *sizes.values())
    full = {k: v for k, v in filled.items() if sizes.get(k, 0) >= least}
    if len(full) == 1:
        return next(iter(full.items()))
    raise StictionError(
        f"{where}: several topics with joint states: {', '.join(full or filled)}: expected "
        "one; name the topic"
    )


def _read(where: str, reader: AnyReader, wanted: Wanted) -> RawLog:
    """Return the log of an arm: its topic of states, and others that are put beside it."""
    n, needed = wanted.n_joints, "tau" if wanted.drive == TORQUE else "q_cmd"
    iiwa = _iiwa_stack(where, reader, wanted.naming)
    if iiwa and needed not in iiwa:
        name = {"tau": "state/JointTorque", "q_cmd": "command/JointPosition"}[needed]
        raise StictionError(f"{where}: no messages of {name}: expected some beside {iiwa['q']}")
    others = {k: (x, IIWA) for k, x in iiwa.items() if k != "q_cmd" or needed == k}
    others = others or _states_and_commands(where, reader, wanted)
    topic, kind = others.pop("q")
    states = _stream(where, reader, topic, kind, wanted, "q" if needed in others else needed)
    keep, notes = np.ones(len(states.marks), bool), []
    for channel, (name, of) in others.items():
        other = _stream(where, reader, name, of, wanted)
        rows, clock = _put_beside(states, channel, other)
        keep &= rows
        if channel == "q_cmd":
            text = f"{name}: commanded positions, each holds until the next"
            text += "; by the times of their recording" * clock
            assumed = f"; in the order of joints 1 to {n} (assumed)"
            notes.append(text + assumed * (not (iiwa or other.joints)))
    if others and not keep.any():
        raise StictionError(
            f"{where}: no state has {' and '.join(others)} beside it: expected some"
        )
    states.keep(keep)
    log = _log(where, states, wanted, iiwa.get("tau", kind.torque))
    for text in notes:
        log.note(text)
    return log


def _states_and_commands(
    where: str, reader: AnyReader, wanted: Wanted
) -> dict[str, tuple[str, Kind]]:
    """Return the topic of an arm's states, and of commands that are needed and not in it."""
    n, naming, told = wanted.n_joints, wanted.naming, _topics(reader, COMMAND_KINDS, commands=True)
    if wanted.drive == POSITION and naming.topic in told:
        told, naming = {naming.topic: told[naming.topic]}, replace(naming, topic=None)
    states = _topic(where, reader, n, naming, wanted.drive)
    if wanted.drive == TORQUE or states[1].q_cmd:
        return {"q": states}
    told = {k: v for k, v in told.items() if _peek(reader, k, v)[1] >= n}
    if len(told) != 1:
        raise StictionError(
            f"{where}: {'several' if told else 'no'} topics with commanded positions"
            f"{': ' * bool(told)}{', '.join(told)}: expected one of a JointState or "
            "Float64MultiArray whose name says command, or a trajectory controller's state"
        )
    return {"q": states, "q_cmd": next(iter(told.items()))}


def _put_beside(states: _Stream, channel: str, other: _Stream) -> tuple[Bools, int]:
    """Add another topic to the states, in place; return rows that have it, and its clock.

    Commands hold until the next one, torques and speeds are interpolated, but not over a gap. The
    clock is 0 for stamps, 1 for times of recording.
    """
    clock = 0 if states.marks[:, 0].any() and other.marks[:, 0].any() else 1
    order = np.argsort(other.marks[:, clock], kind="stable")
    values, stamps = other.data["q"][order], other.marks[order, clock]
    at = states.marks[:, clock]
    last, keep = held(stamps, at)
    if channel == "q_cmd":
        states.data[channel] = values[last]
        return keep, clock
    # float of seconds since 1970 would round by 100 ns
    known, now = (stamps - stamps[0]).astype(float), (at - stamps[0]).astype(float)
    states.data[channel] = np.stack([np.interp(now, known, x) for x in values.T], axis=1)
    right = np.searchsorted(stamps, at, side="left").clip(0, len(stamps) - 1)
    step = np.median(np.diff(known)) if len(known) > 1 else 0.0
    keep &= (at <= stamps[-1]) & (known[right] - known[last] <= MOST_STEPS * step)
    return keep, clock


def _stream(
    where: str, reader: AnyReader, topic: str, kind: Kind, wanted: Wanted, needed: str = "q"
) -> _Stream:
    """Read the messages of a topic: angles, a channel that is needed, and others if there."""
    n, place = wanted.n_joints, f"{where}, {topic}"
    names, _, _ = _peek(reader, topic, kind)
    joints = find_joints(place, names, n, wanted.naming) if names else ()
    orders: dict[tuple[tuple[str, ...] | None, int], list[int]] = {}
    # numbers, not messages: half an hour at 1 kHz has two million of these
    values: dict[str, array[float]] = {}
    marks, others = array("q"), 0
    for number, (time, sample) in enumerate(_samples(reader, topic, kind), 1):
        here, key = f"{place}, message {number}", (sample.names, len(sample.q))
        if key not in orders:
            orders[key] = _order(here, sample, joints, wanted)
        order = orders[key]
        if not order:
            others += 1
            continue
        channels = {"q": sample.q, "dq": sample.dq, "tau": sample.tau, "q_cmd": sample.q_cmd}
        if not values:
            values = {k: array("d") for k, x in channels.items() if k in ("q", needed) or len(x)}
        count = len(sample.q) if sample.names is None else len(sample.names)
        for k, into in values.items():
            _check_size(here, kind, k, len(channels[k]), count)
            into.extend(channels[k][order])
        marks.extend((sample.stamp, time, number))
        check_size(place, len(marks) // 3, 1 + len(values) * n)
    data = {k: np.array(x, np.float64).reshape(-1, n) for k, x in values.items()}
    # ros2_control publishes NaN for what a robot does not measure
    data = {k: x for k, x in data.items() if k == needed or not np.isnan(x).all()}
    return _Stream(topic, kind, joints, np.array(marks, np.int64).reshape(-1, 3), data, others)


def _log(where: str, stream: _Stream, wanted: Wanted, torque: str) -> RawLog:
    """Return a log with the rows of a topic; ``torque`` is where its torques are from."""
    place, (stamps, times, numbers) = f"{where}, {stream.topic}", stream.marks.T
    log = RawLog(
        source=where,
        t=np.arange(float(len(numbers))),
        data=stream.data,
        run=np.zeros(len(numbers), np.int64),
        place=lambda i: f"{place}, message {numbers[i]}",
        side=side_of(stream.kind, stream.joints),
    )
    if wanted.time and len(numbers):
        if not stamps.any():
            stamps = times
            log.warnings.append(
                "messages have no stamp: times are those at which they were recorded"
            )
        # in whole nanoseconds before it becomes a float
        log.t, log.origin = (stamps - stamps[0]).astype(np.float64) / _NS, int(stamps[0]) / _NS
    text = stream.topic
    if "tau" in stream.data:
        text += f": tau is {torque}" + ", measured behind the gear" * bool(log.side)
    if stream.joints:
        text += f"; joints 1 to {wanted.n_joints} are {', '.join(stream.joints)}"
    else:
        text += "; messages do not name their joints, which are taken in their order"
    if stream.others:
        text += f"; {stream.others} messages of other joints left out"
    log.note(text, stream.others)
    return log


def _order(place: str, sample: Sample, joints: tuple[str, ...], wanted: Wanted) -> list[int]:
    """Return where joints 1 to n stand in a message; none in one that is not of this arm."""
    n, naming = wanted.n_joints, wanted.naming
    if sample.names is None:
        if len(sample.q) == len(naming.whole):
            return [naming.whole.index(x) for x in naming.robot]
        if len(sample.q) != n:
            raise StictionError(
                f"{place}: {len(sample.q)} joints, but the robot has {n}: expected a log of it"
            )
        return list(range(n))
    missing = [x for x in joints if x not in sample.names]
    if len(missing) == n:
        return []
    if missing:
        raise StictionError(
            f"{place}: without {', '.join(missing)}, which other messages have: expected all {n} "
            "joints in one message; two publishers?"
        )
    return [sample.names.index(x) for x in joints]


def _check_size(place: str, kind: Kind, channel: str, size: int, n: int) -> None:
    """Check that a message has one value of a channel for each of ``n`` joints."""
    names = {"q": "position", "dq": "velocity", "tau": kind.torque, "q_cmd": "commanded position"}
    if channel == "tau" and not size:
        raise StictionError(
            f"{place}: {kind.torque} is empty: expected the torques of all joints [N·m]; does the "
            "driver publish them?"
        )
    if size != n:
        raise StictionError(
            f"{place}: {size} values of {names[channel]}: expected {n}, one a joint"
        )
