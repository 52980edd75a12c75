"""Find the channels of a robot among the columns of a joint log."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.joint_names import Naming

TORQUE, POSITION = DRIVES = ("torque", "position")
"""Drives of the joints of a log: torque (a joint log), or a servo that gets positions."""


CHANNELS = {
    TORQUE: (("q", "tau"), ("dq", "temperature", "tau_cmd")),
    POSITION: (("q_cmd", "q"), ("dq", "tau", "current_abs", "temperature")),
}
"""Channels of each joint by drive. Required: angle ``q`` [rad], torque ``tau`` [N·m], commanded
angle ``q_cmd`` [rad]; optional: speed ``dq`` [rad/s], ``temperature`` [°C], commanded torque
``tau_cmd`` [N·m], size of the motor's current ``current_abs`` [any unit]."""

RUN = "run"
"""Optional column of names: where it changes, another recording begins and time may start anew."""

_CHANNEL = re.compile(r"([a-z_]*[a-z])([1-9]\d?)")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Positions of a log's channels among its columns, from 0."""

    t: int
    channels: dict[str, tuple[int, ...]]
    """Columns of joints 1..n for the required channels, and whichever optional ones are there."""
    run: int | None
    ignored: tuple[str, ...]
    """Names of columns that nothing reads."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns that hold numbers: t where there is one, then the channels in their order."""
        found = (self.t, *(c for group in self.channels.values() for c in group))
        return tuple(c for c in found if c >= 0)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Request to read a log file."""

    n_joints: int
    time: bool = True
    """Whether the log must have time; without, rows are numbered."""
    naming: Naming
    """Names of the joints, where a log has names."""
    drive: str = TORQUE
    """Which channels: those of `CHANNELS` for torque or position."""


def joints_of(names: Sequence[str]) -> int:
    """Return the highest joint that has a column of angles; 0 without any."""
    found = [_CHANNEL.fullmatch(name.strip()) for name in names]
    return max((int(m[2]) for m in found if m and m[1] == "q"), default=0)


def drives_in(names: Sequence[str]) -> tuple[str, ...]:
    """Return the possible drives of a log with these columns: `TORQUE`, `POSITION`, both, none."""
    found = [_CHANNEL.fullmatch(name.strip()) for name in names]
    channels = {m[1] for m in found if m}
    return tuple(d for d, mark in ((TORQUE, "tau"), (POSITION, "q_cmd")) if mark in channels)


def sort_columns(
    where: str, header: Sequence[str], wanted: Wanted, shown: Sequence[str]
) -> Columns:
    """Find the channels of a robot in the ``header``, in any order; without time ``t`` is -1.

    ``shown`` are the names of the columns in the file, the beginning of every message is ``where``.

    Raises:
        StictionError: a column is missing or there twice, or the log has another number of joints.
    """
    n_joints, time, (required, optional) = wanted.n_joints, wanted.time, CHANNELS[wanted.drive]
    must, more = (",".join(f"{c}1..{c}{n_joints}" for c in x) for x in (required, optional))
    may = f"expected {'t,' if time else ''}{must} with optional {more},{RUN}"
    may += "; columns OURS=NAME renames"
    names = [name.strip() for name in header]
    found: dict[str, dict[int, int]] = {}
    for i, name in enumerate(names):
        match = _CHANNEL.fullmatch(name)
        is_channel = match is not None and match[1] in required + optional
        known = is_channel or name == RUN or (time and name == "t")
        if known and names.index(name) != i:
            raise StictionError(f"{where}: column {name!r} is there twice: {may}")
        if match and is_channel:
            found.setdefault(match[1], {})[int(match[2])] = i
    if time and "t" not in names:
        raise StictionError(f"{where}: missing column 't' (time in s): {may}")
    counts = {max(found[channel]) for channel in required if channel in found}
    sizes = {len(found[channel]) for channel in required if channel in found}
    if counts != {n_joints} and len(counts) == 1 and sizes == counts:
        raise StictionError(
            f"{where}: columns for {max(counts)} joints, but the robot has {n_joints}: {may}"
        )
    for channel in required:
        extra = [j for j in found.get(channel, {}) if j > n_joints]
        if extra:
            raise StictionError(
                f"{where}: column '{channel}{extra[0]}', but the robot has {n_joints} joints: {may}"
            )
    channels: dict[str, tuple[int, ...]] = {}
    for channel in required + optional:
        joints = found.get(channel, {})
        missing = [j for j in range(1, n_joints + 1) if j not in joints]
        if not missing:
            channels[channel] = tuple(joints[j] for j in range(1, n_joints + 1))
        elif channel in required or (channel == "dq" and joints):
            what = ", ".join(f"'{channel}{j}'" for j in missing)
            plural = "s" if len(missing) > 1 else ""
            raise StictionError(f"{where}: missing column{plural} {what}: {may}")
    used = {c for group in channels.values() for c in group}
    used |= {i for i, name in enumerate(names) if name == RUN or (time and name == "t")}
    return Columns(
        t=names.index("t") if time else -1,
        channels=channels,
        run=names.index(RUN) if RUN in names else None,
        ignored=tuple(x.strip() for i, x in enumerate(shown) if i not in used and x),
    )
