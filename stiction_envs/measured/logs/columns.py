"""Find the channels of a robot among the columns of a joint log."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stiction_envs.errors import StictionError

REQUIRED = ("q", "tau")
"""Channels every log has: angle [rad] and torque [N·m] of each joint."""

OPTIONAL = ("dq", "temperature", "tau_cmd")
"""Channels used where they are there: speed [rad/s], temperature [°C], commanded torque [N·m]."""

RUN = "run"
"""Optional column of names: where it changes, another recording begins and time may start anew."""

_CHANNEL = re.compile(r"(q|dq|tau|temperature|tau_cmd)(0|[1-9]\d?)")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Where the channels of a log stand among its columns, counted from 0."""

    t: int
    channels: dict[str, tuple[int, ...]]
    """Columns of joints 1..n for ``q``, ``tau`` and whichever of :data:`OPTIONAL` are there."""
    run: int | None
    ignored: tuple[str, ...]
    """Names of columns that nothing reads."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns that hold numbers: t, then the channels in their order."""
        return (self.t, *(c for group in self.channels.values() for c in group))


def joints_of(names: Sequence[str]) -> int:
    """Return the highest joint that has a column of angles; 0 without any."""
    found = [_CHANNEL.fullmatch(name.strip()) for name in names]
    return max((int(m[2]) for m in found if m and m[1] == "q"), default=0)


def expected(n_joints: int, *, time: bool = True) -> str:
    """The columns of a log, for the end of a message."""
    n = n_joints
    text = f"{'t,' if time else ''}q1..q{n},tau1..tau{n}"
    return f"expected {text} with optional {','.join(f'{c}1..{c}{n}' for c in OPTIONAL)},{RUN}"


def sort_columns(where: str, header: Sequence[str], n_joints: int, *, time: bool = True) -> Columns:
    """Find the channels of a robot with ``n_joints`` joints in the ``header``.

    Args:
        where: file, the beginning of every message.
        header: names of the columns, in any order; spaces around them do not count.
        n_joints: joints of the robot.
        time: whether there must be a column ``t``; without, ``t`` is -1.

    Raises:
        StictionError: a column is missing or there twice, or the log has another number of joints.
    """
    names = [name.strip() for name in header]
    may = expected(n_joints, time=time)
    found: dict[str, dict[int, int]] = {}
    for i, name in enumerate(names):
        match = _CHANNEL.fullmatch(name)
        known = match is not None or name == RUN or (time and name == "t")
        if known and names.index(name) != i:
            raise StictionError(f"{where}: column {name!r} is there twice: {may}")
        if match:
            found.setdefault(match[1], {})[int(match[2])] = i
    if time and "t" not in names:
        raise StictionError(f"{where}: missing column 't' (time in s): {may}")
    _check_joints(where, found, n_joints, may)
    channels: dict[str, tuple[int, ...]] = {}
    for channel in (*REQUIRED, *OPTIONAL):
        joints = found.get(channel, {})
        missing = [j for j in range(1, n_joints + 1) if j not in joints]
        if not missing:
            channels[channel] = tuple(joints[j] for j in range(1, n_joints + 1))
        elif channel in REQUIRED or (channel == "dq" and joints):
            what = ", ".join(f"'{channel}{j}'" for j in missing)
            plural = "s" if len(missing) > 1 else ""
            raise StictionError(f"{where}: missing column{plural} {what}: {may}")
    used = {c for group in channels.values() for c in group}
    used |= {i for i, name in enumerate(names) if name == RUN or (time and name == "t")}
    return Columns(
        t=names.index("t") if time else -1,
        channels=channels,
        run=names.index(RUN) if RUN in names else None,
        ignored=tuple(name for i, name in enumerate(names) if i not in used and name),
    )


def _check_joints(where: str, found: dict[str, dict[int, int]], n_joints: int, may: str) -> None:
    for channel in (*REQUIRED, "dq"):
        joints = found.get(channel, {})
        if 0 in joints:
            raise StictionError(f"{where}: column '{channel}0', but joints count from 1: {may}")
    counts = {max(found[channel]) for channel in REQUIRED if channel in found}
    if len(counts) == 1 and counts != {n_joints}:
        count = counts.pop()
        if all(len(found[channel]) == count for channel in REQUIRED if channel in found):
            raise StictionError(
                f"{where}: columns for {count} joints, but the robot has {n_joints}: {may}"
            )
    for channel in REQUIRED:
        extra = [j for j in found.get(channel, {}) if j > n_joints]
        if extra:
            raise StictionError(
                f"{where}: column '{channel}{extra[0]}', but the robot has {n_joints} joints: {may}"
            )
