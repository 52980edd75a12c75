"""Our names of other people's columns: one table of words, and one of units.

A name is cut into words and numbers: ``joint_a1_pos [deg]`` has the quantity *pos*, the joint *a 1*
and the unit *deg*. Words such as *target* make a quantity a command; what is left names the joint.
The reader reports each column that it reads under another name or in another unit.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi
from typing import NamedTuple

from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.logs.columns import RUN
from stiction_envs.measured.logs.joint_names import Naming, check_unnamed, find_joints

WORDS = {
    "q": "q pos position positions angle angles theta qpos",
    "dq": "dq qd qdot vel velocity velocities speed omega dtheta qvel",
    "tau": "tau torque torques effort efforts eff moment trq",
    "current_abs": "current currents curr amps",
    "temperature": "temperature temperatures temp",
    "q_cmd": "qdes qref qcmd",
    "commanded": "cmd command commanded des desired target ref reference goal set setpoint d",
    "weak": "angle angles current",
    "no name": "joint joints jnt j axis a motor m robot arm state actual act measured meas msr "
    "feedback fb current",
    "time": "t time timestamp stamp sec secs seconds elapsed relative zeit temps tiempo tempo",
}
"""By channel; then those that make a command of a quantity, that beside another quantity are part
of a joint's name, and that name no joint. ``qd`` is a speed, as in Corke's Robotics Toolbox."""
COMMANDED, WEAK, NO_NAME, TIMES = (set(x.split()) for x in list(WORDS.values())[-4:])
COMMANDS = {"q": "q_cmd", "tau": "tau_cmd", "q_cmd": "q_cmd"}
"""Channels of what was commanded."""

_TURN = {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180, "°": pi / 180, "rev": 2 * pi}
_ANGLE = {k + end: x for k, x in _TURN.items() for end in ("", "s", "ian", "ians", "ree", "rees")}
_SPEED = {k + end: x for k, x in _TURN.items() for end in ("/s", "/sec", "s", "ps", "pers")}
_SPEED |= {"rpm": pi / 30, "rev/min": pi / 30, "1/min": pi / 30}
_CURRENT = {"a": 1.0, "ma": 1e-3}
_TORQUE = {"nm": 1.0, "mnm": 1e-3, "knm": 1e3, "ncm": 1e-2, **_CURRENT}
_TIME = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNITS = {
    "t": _TIME | {"µs": 1e-6, "μs": 1e-6},
    **dict.fromkeys(("q", "q_cmd"), _ANGLE),
    "dq": _SPEED,
    **dict.fromkeys(("tau", "tau_cmd"), _TORQUE),
    "current_abs": _CURRENT,
    "temperature": dict.fromkeys(("c", "°c", "degc"), 1.0),
}
"""Our units in one of a channel, by its small letters without blanks and dots."""
MOST_SHOWN = 12  # most columns that a message lists; assumed

_CHANNELS = {word: name for name, words in list(WORDS.items())[:-4] for word in words.split()}
_OURS = re.compile(r"(q|dq|tau|q_cmd|tau_cmd|temperature|current_abs)(0|[1-9]\d?)")
_BRACKET = re.compile(r"\s*[\[({<]([^\[\](){}<>\d]*)[\])}>]$")
_RANGE = re.compile(r"([a-z_]+)(\d{1,2})\.\.\1(\d{1,2})")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zµμ°]+|\d+")


class Column(NamedTuple):
    """Meaning of a column's name."""

    channel: str
    joint: tuple[str, ...]
    """Words and numbers of its joint; () of time."""
    unit: str
    """Empty where none is said."""

    @property
    def number(self) -> int | None:
        """Return the joint's number, where nothing else names it; 1 where nothing does."""
        rest = [x for x in self.joint if x not in NO_NAME]
        if not rest and all(len(x) > 1 for x in self.joint):
            return 1
        return int(rest[0]) if len(rest) == 1 and rest[0].isdigit() else None

    @property
    def key(self) -> str:
        """Return the key of its joint: the number, else the name."""
        return "".join(self.joint) if self.number is None else str(self.number)


@dataclass(kw_only=True)
class OurNames:
    """Columns of a table by our names."""

    names: list[str]
    """Empty where a column is not ours."""
    factors: dict[int, float] = field(default_factory=dict)
    """Our units in one of a column's, by its place, where that is not 1."""
    notes: list[str] = field(default_factory=list)


def unit_of(text: str) -> str | None:
    """Return a unit as `UNITS` has it, empty for no text; None for one of no channel."""
    unit = re.sub(r"[\s·*.^\[\](){}_-]", "", text).lower()
    return unit if not unit or any(unit in known for known in UNITS.values()) else None


def column_of(name: str) -> Column | None:
    """Return the meaning of a column's name; None if it has none of our words."""
    bracket, unit = _BRACKET.search(name), ""
    if bracket and (unit_of(bracket[1]) or set(_words(bracket[1])) - NO_NAME - COMMANDED):
        name, unit = name[: bracket.start()], bracket[1].strip()
    if match := _OURS.fullmatch(name):
        return Column(match[1], (match[2],), unit)
    words = _words(name)
    if words and set(words) <= TIMES | set(UNITS["t"]):
        last = words[-1] if len(words) > 1 and words[-1] in UNITS["t"] else ""
        return Column("t", (), unit or last)
    known = [i for i, word in enumerate(words) if word in _CHANNELS]
    places = [i for i in known if words[i] not in WEAK] or known[-1:]
    channels = {_CHANNELS[words[i]] for i in places}
    if len(channels) != 1:
        return None
    (channel,) = channels
    rest = [word for i, word in enumerate(words) if i not in places]
    if channel == "tau" and "abs" in rest:
        channel = "current_abs"  # a size without a sign is no torque
    if channel == "q" and "dot" in rest:
        channel = "dq"
    if COMMANDED & set(rest):
        if channel not in COMMANDS:
            return None
        channel = COMMANDS[channel]
    for k in (3, 2, 1):
        end = "".join(rest[-k:])
        # one letter is rather a joint's name
        if not unit and len(end) > 1 and len(rest) >= k and end in UNITS[channel]:
            rest, unit = rest[:-k], end
    drop = COMMANDED | {"dot", "abs", *(["current"] if known != places else [])}
    return Column(channel, tuple(x for x in rest if x not in drop), unit)


def our_names(
    where: str,
    header: Sequence[str],
    naming: Naming,
    n_joints: int | None = None,
    units: Sequence[str] = (),
) -> OurNames:
    """Return our names of the columns of a table, and the factors of their units.

    Args:
        where: the log, the beginning of every message.
        header: names of its columns.
        naming: names of its joints, and of columns.
        n_joints: joints of the robot; None where none is known.
        units: of its columns, where a row of the table says them.

    Raises:
        StictionError: a unit that is not known, two columns for one channel of a joint, or joints
            that have names and cannot be found.
    """
    names = _renamed(where, header, naming.columns)
    columns = [column_of(x.strip()) for x in names]
    out = OurNames(names=[x if x == RUN else "" for x in names])
    joints = _joints(where, [c for c in columns if c and c.channel != "t"], n_joints, naming, out)
    found: dict[str, list[int]] = {}
    for i, column in enumerate(columns):
        if column and column.channel == "t":
            found.setdefault("t", []).append(i)
        elif column and column.key in joints:
            found.setdefault(f"{column.channel}{joints[column.key]}", []).append(i)
    other: dict[str, list[int]] = {}
    converted: dict[str, None] = {}
    for ours, places in found.items():
        exact = [i for i in places if names[i].strip() == ours]
        chosen = exact or (places[:1] if ours == "t" else places)
        if len(chosen) > 1 and not exact:
            if ours.rstrip("0123456789") not in ("q", "tau", "q_cmd"):
                continue
            both = " and ".join(repr(header[i]) for i in chosen[:2])
            raise StictionError(
                f"{where}: columns {both} may both be {ours}: expected one; say which with "
                f"columns {ours}=NAME"
            )
        for i in chosen:
            out.names[i], column = ours, columns[i]
            channel, unit = ours.rstrip("0123456789"), column.unit if column else ""
            if _BRACKET.sub("", header[i]).strip() != ours:
                other.setdefault(channel, []).append(i)
            unit = unit or (units[i] if units else "")
            if not unit_of(unit) and unit_of(unit) is not None:
                continue
            if naming.units and channel in ("q", "q_cmd", "dq"):
                continue
            factor = UNITS[channel].get(unit_of(unit) or "")
            if factor is None:
                expected = unknown("unit", unit, UNITS[channel])
                raise StictionError(f"{where}: column {header[i]!r}: {expected}")
            out.factors |= {i: factor} if factor != 1 else {}
            currents = ", which is a current" * (channel == "tau" and unit_of(unit) in _CURRENT)
            converted[f"{channel} in {unit.replace('nm', 'N·m')}{currents}"] = None
    said = [
        f"{header[x[0]]} is {out.names[x[0]]}"
        if len(x) == 1
        else f"{header[x[0]]} to {header[x[-1]]} are {out.names[x[0]]} to {out.names[x[-1]]}"
        for x in other.values()
    ]
    out.notes += [f"columns by other names: {'; '.join(said)}"] if said else []
    out.notes += [f"units as the table says: {', '.join(converted)}"] if converted else []
    return out


def listed_names(given: Sequence[str]) -> list[str]:
    """Return the names that a person gives for all columns; ``q1..q3`` stands for three."""
    names: list[str] = []
    for word in given:
        if match := _RANGE.fullmatch(word):
            names += [f"{match[1]}{j}" for j in range(int(match[2]), int(match[3]) + 1)]
        elif "=" not in word:
            names.append(word)
    return names


def _words(name: str) -> list[str]:
    return [x.lower() for x in _WORD.findall(name)]


def _renamed(where: str, header: Sequence[str], given: Sequence[str]) -> list[str]:
    """Return names as a person gives them: all, in the order of the columns, or OURS=NAME."""
    names = listed_names(given) or list(header)
    if len(names) != len(header):
        raise StictionError(
            f"{where}: columns: {len(names)} names for {len(header)} columns: expected one each"
        )
    for word in (x for x in given if "=" in x):
        ours, _, theirs = word.partition("=")
        if ours not in UNITS and not _OURS.fullmatch(ours):
            raise StictionError(f"columns: {ours!r}: expected t, q, q1, tau …, as in t=NAME")
        whole = ours == "t" or ours not in UNITS  # else those of all joints
        places = [
            i for i, x in enumerate(names) if x == theirs or (not whole and x.startswith(theirs))
        ]
        if not places:
            raise StictionError(f"{where}: {unknown('column', theirs, header[:MOST_SHOWN])}")
        for i in places:
            names[i] = f"{ours}{names[i][len(theirs) :]}"
    return names


def _joints(
    where: str, columns: Sequence[Column], n_joints: int | None, naming: Naming, out: OurNames
) -> dict[str, int]:
    """Return the number of each joint by its `Column.key`."""
    columns = [c for c in columns if c.channel == "q"] or columns
    keys = {"".join(c.joint): c.key for c in columns} | {c.key: c.key for c in columns}
    for wanted in (naming.joints, naming.robot):
        found = [keys.get("".join(_words(x))) for x in wanted]
        if wanted and None not in found:
            out.notes.append(f"joints 1 to {len(wanted)} are {', '.join(wanted)}")
            return {str(key): j for j, key in enumerate(found, 1)}
    if naming.joints and all(len(c.joint) < 2 for c in columns):
        check_unnamed(where, naming)
    numbers = sorted({c.number for c in columns if c.number is not None})
    if numbers and not naming.joints:
        whole = [naming.whole.index(x) for x in naming.robot if x in naming.whole]
        if len(naming.whole) == len(numbers) > len(whole) == n_joints:
            shown = ", ".join(str(numbers[k]) for k in whole)
            out.notes.append(f"joints {shown} of the whole robot's {len(numbers)} are read")
            return {str(numbers[k]): j for j, k in enumerate(whole, 1)}
        return {str(x): x + (numbers[0] == 0) for x in numbers}
    names = {"_".join(c.joint): c.key for c in columns}
    try:
        order = find_joints(where, list(names), n_joints, naming) if names else ()
    except StictionError:
        if n_joints is not None or naming.joints:
            raise
        order = tuple(names)  # without a robot they are only counted
    out.notes += [f"joints 1 to {len(order)} are {', '.join(order)}"] if order else []
    return {names[x]: j for j, x in enumerate(order, 1)}
