"""ROS bags: ROS 1 ``.bag``, ROS 2 ``.mcap`` and ``.db3``, or the folder that ROS 2 records into.

Read with `rosbags`, which needs no ROS. One topic is read: the only one with states of so many
joints and torques, or the one asked for. Messages with none of the arm's joints (a gripper that
publishes to the same topic) are left out. A message with only some of them is an error: the
others are then unknown. Bags of iiwa_stack have a topic for each quantity (`iiwa_stack`).
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stiction_envs.errors import StictionError, missing_extra, unknown
from stiction_envs.measured.logs.columns import TORQUE
from stiction_envs.measured.logs.formats import iiwa_stack
from stiction_envs.measured.logs.formats.base import LogFormat, RawLog, Wanted, check_size
from stiction_envs.measured.logs.formats.messages import BY_TYPE, Kind, Sample, side_of
from stiction_envs.measured.logs.joint_names import Naming, find_joints

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

METADATA = "metadata.yaml"
"""In every folder that ROS 2 records into."""
_PEEK = 1000
"""Messages that show who publishes to a topic; assumed."""
_NS = 10**9


class RosBag(LogFormat):
    """A recording of ROS."""

    ends: ClassVar = (".bag", ".mcap", ".db3")

    def matches_folder(self, path: Path) -> bool:
        """Return whether ROS 2 recorded into it."""
        return (path / METADATA).is_file()

    def read(self, where: str, wanted: Wanted) -> RawLog:
        """See `LogFormat.read`."""
        with _open(where) as reader:
            topics = _iiwa_stack(where, reader, wanted.naming)
            if topics:
                return iiwa_stack.read_arm(where, reader, topics, wanted)
            if wanted.drive != TORQUE:
                raise StictionError(f"{where}: no commanded positions: expected columns q_cmd1..n")
            topic, kind = _topic(where, reader, wanted.n_joints, wanted.naming)
            return _read(where, reader, topic, kind, wanted)

    def count(self, where: str, naming: Naming) -> int:
        """See `LogFormat.count`."""
        with _open(where) as reader:
            if _iiwa_stack(where, reader, naming):
                return len(iiwa_stack.JOINTS)
            topic, kind = _topic(where, reader, None, naming)
            names, most = _peek(reader, topic, kind)
        return len(find_joints(where, names, None, naming)) if names else most

    def drives(self, where: str, naming: Naming) -> tuple[str, ...]:
        """See `LogFormat.drives`."""
        with _open(where) as reader:
            topics = _iiwa_stack(where, reader, naming)
        return iiwa_stack.drives_of(topics) if topics else (TORQUE,)


def _iiwa_stack(where: str, reader: AnyReader, naming: Naming) -> dict[str, str]:
    """Return the topics of iiwa_stack's arm, by channel; none where other states are there."""
    types = {c.topic: str(c.msgtype) for c in reader.connections}
    found = iiwa_stack.arms(types)
    if not found or any(c.msgtype in BY_TYPE and c.msgcount for c in reader.connections):
        asked = {t for topics in found.values() for t in topics.values()}
        if naming.topic not in asked:
            return {}
    return iiwa_stack.arm_of(where, found, naming.topic)


@contextmanager
def _open(where: str) -> Iterator[AnyReader]:
    """Open a bag; any failure while it is open becomes one error."""
    try:
        from rosbags.highlevel import AnyReader  # here: few logs need it, and it takes a moment
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing_extra(f"{where}: reading a ROS bag", "rosbags", "ros") from None
    try:
        # for bags that do not describe their messages themselves, as older ones of ROS 2
        known = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([Path(where)], default_typestore=known) as reader:
            yield reader
    except StictionError:
        raise
    except Exception as error:
        # damaged bags raise almost anything, from struct.error to apsw's and zstd's own
        reason = " ".join(str(error).split()).replace(where, "").strip()[:80]
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


def _peek(reader: AnyReader, topic: str, kind: Kind) -> tuple[list[str], int]:
    """Return the joints that the first messages of a topic name, and how many torques they have."""
    names: dict[str, None] = {}
    most = 0
    for _, sample in islice(_samples(reader, topic, kind), _PEEK):
        names |= dict.fromkeys(sample.names or ())
        most = max(most, len(sample.tau))
    return list(names), most


def _topic(where: str, reader: AnyReader, n_joints: int | None, naming: Naming) -> tuple[str, Kind]:
    """Return the topic with the arm's states."""
    types = {c.topic: c.msgtype for c in reader.connections}
    known = {k: BY_TYPE[v] for k, v in types.items() if v in BY_TYPE}
    counts = {k: sum(c.msgcount for c in reader.connections if c.topic == k) for k in known}
    if naming.topic is not None:
        if naming.topic not in types:
            raise StictionError(f"{where}: {unknown('topic', naming.topic, known or types)}")
        if naming.topic not in known:
            raise StictionError(
                f"{where}, {naming.topic}: holds {types[naming.topic]}: expected one of "
                f"{', '.join(BY_TYPE)}"
            )
        known = {naming.topic: known[naming.topic]}
    if not known:
        shown = ", ".join(f"{k} ({v})" for k, v in islice(types.items(), 5)) or "none"
        more = f" and {len(types) - 5} more" if len(types) > 5 else ""
        raise StictionError(
            f"{where}: no states of joints, its topics are {shown}{more}: expected one of "
            f"{', '.join(BY_TYPE)}"
        )
    for topic in known:
        if types[topic] not in reader.typestore.fielddefs:
            raise StictionError(
                f"{where}, {topic}: the bag does not describe {types[topic]}: expected one of "
                "sensor_msgs/msg/JointState, or a bag recorded with ROS 2 Iron or later"
            )
    filled = {k: v for k, v in known.items() if counts[k]}
    if not filled:
        raise StictionError(f"{where}, {next(iter(known))}: no messages: expected one second")
    if len(filled) == 1:
        return next(iter(filled.items()))
    seen = {k: _peek(reader, k, v) for k, v in filled.items()}
    sizes = {k: (len(names) or most) if most else 0 for k, (names, most) in seen.items()}
    least = n_joints or max(1, *sizes.values())
    full = {k: v for k, v in filled.items() if sizes[k] >= least}
    if len(full) == 1:
        return next(iter(full.items()))
    raise StictionError(
        f"{where}: several topics with states of joints: {', '.join(full or filled)}: expected "
        "one; name the topic"
    )


def _read(where: str, reader: AnyReader, topic: str, kind: Kind, wanted: Wanted) -> RawLog:
    n, place = wanted.n_joints, f"{where}, {topic}"
    names, _ = _peek(reader, topic, kind)
    joints = find_joints(place, names, n, wanted.naming) if names else ()
    orders: dict[tuple[str, ...] | None, list[int]] = {}
    # numbers, not messages: half an hour at 1 kHz has two million of these
    q, dq, tau = array("d"), array("d"), array("d")
    stamps, times, numbers = array("q"), array("q"), array("q")
    others = 0
    for number, (time, sample) in enumerate(_samples(reader, topic, kind), 1):
        here = f"{place}, message {number}"
        if sample.names not in orders:
            orders[sample.names] = _order(here, sample, joints, n)
        order = orders[sample.names]
        if not order:
            others += 1
            continue
        has_speed = len(dq) > 0 if len(q) else len(sample.dq) > 0
        _check_sizes(here, kind, sample, has_speed)
        q.extend(sample.q[order])
        tau.extend(sample.tau[order])
        if has_speed:
            dq.extend(sample.dq[order])
        stamps.append(sample.stamp)
        times.append(time)
        numbers.append(number)
        check_size(place, len(numbers), 1 + 3 * n)
    channels = {"q": q, "tau": tau, **({"dq": dq} if dq else {})}
    log = RawLog(
        source=where,
        t=np.arange(float(len(numbers))),
        data={k: np.array(v, np.float64).reshape(-1, n) for k, v in channels.items()},
        run=np.zeros(len(numbers), np.int64),
        place=lambda i: f"{place}, message {numbers[i]}",
        side=side_of(kind, joints),
    )
    if wanted.time and numbers:
        _set_time(log, stamps, times)
    text = f"{topic}: tau is {kind.tau}" + (", measured behind the gear" if log.side else "")
    if joints:
        text += f"; joints 1 to {len(joints)} are {', '.join(joints)}"
    if others:
        text += f"; {others} messages of other joints left out"
    log.note(text, others)
    return log


def _order(place: str, sample: Sample, joints: tuple[str, ...], n: int) -> list[int]:
    """Return where joints 1 to n stand in a message; none in one that is not of this arm."""
    if sample.names is None:
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


def _check_sizes(place: str, kind: Kind, sample: Sample, has_speed: bool) -> None:
    """Every joint has an angle, and a torque; a speed where others have."""
    if not len(sample.tau):
        raise StictionError(
            f"{place}: {kind.tau} is empty: expected the torques of all joints [N·m]; does the "
            "driver publish them?"
        )
    n = len(sample.q) if sample.names is None else len(sample.names)
    sizes = {"position": len(sample.q), kind.tau: len(sample.tau)}
    if has_speed:
        sizes["velocity"] = len(sample.dq)
    for what, size in sizes.items():
        if size != n:
            raise StictionError(f"{place}: {size} values of {what}: expected {n}, one a joint")


def _set_time(log: RawLog, stamps: array[int], times: array[int]) -> None:
    """Count time from the first row, in whole nanoseconds before it becomes a float."""
    if not any(stamps):
        stamps = times
        log.warnings.append("messages have no stamp: times are those at which they were recorded")
    first = stamps[0]
    log.t = np.array([x - first for x in stamps], np.float64) / _NS
    log.origin = first / _NS
