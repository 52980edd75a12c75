"""Find joints 1 to n of the robot among a log's named joints.

The caller may name them. Else they have the names of the robot's own joints, or are found by
number: ``panda_joint1`` to ``panda_joint7``, ``lbr_joint_0`` to ``lbr_joint_6``, ``A1`` to ``A7``
are joints 1 to 7, besides others in the log (a gripper's fingers). The order in a message is not
used: with ``joint_state_broadcaster`` of ROS 2 it is random.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from stiction_envs.errors import StictionError, unknown

if TYPE_CHECKING:
    from stiction_envs.robots import Arm


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Facts about the joints of a log: names, and units of their angles."""

    robot: tuple[str, ...] = ()
    """Names of the robot's joints, base to flange."""
    whole: tuple[str, ...] = ()
    """Names of all joints in the order of the robot's file, where `robot` is a chain; else ()."""
    held: tuple[tuple[int, str], ...] = ()
    """Joints that the robot's model holds still: their place among its joints and them, from 0, and
    their name."""
    joints: tuple[str, ...] = ()
    """Names in the log of joints 1 to n; () to find them (`find_joints`)."""
    topic: str | None = None
    """Topic of a ROS bag that has several; None for the only one."""
    units: str | None = None
    """Unit of the log's angles: rad, deg, percent (of calibrated ranges) or ticks (encoder steps);
    None for rad, or the unit that the log shows (`units`)."""
    calibration: str | os.PathLike[str] | None = None
    """File of lerobot with the ranges of the motors, for percent and encoder steps."""
    columns: tuple[str, ...] = ()
    """Names of a table's columns: all in their order, or some as ``OURS=NAME``; () where the names
    are ours or well known (`aliases.our_names`)."""

    @property
    def record(self) -> dict[str, object]:
        """What a person said of how logs are read, for provenance."""
        return {k: getattr(self, k) for k in ("joints", "topic", "units", "columns")}

    @property
    def files(self) -> dict[str, Path]:
        """The files that it names, by the name of their argument."""
        file = self.calibration
        return {} if file is None else {"calibration": Path(file)}


class Reading(TypedDict, total=False):
    """Instructions of a person on how to read logs; `Naming` describes the fields."""

    joints: Sequence[str]
    topic: str | None
    units: str | None
    calibration: str | os.PathLike[str] | None
    columns: Sequence[str]


def naming_of(arm: Arm | None, reading: Reading) -> Naming:
    """Return the names of joints, from an arm (None: no robot) and a caller's options.

    Raise a StictionError where the calibration is not there.
    """
    given: dict[str, Any] = {k: x for k, x in reading.items() if k in Reading.__annotations__}
    given |= {k: tuple(given[k]) for k in ("joints", "columns") if k in given}
    if arm is not None:
        given |= {"robot": arm.joint_names, "whole": arm.whole, "held": arm.stated.held}
    naming = Naming(**given)
    for file in (x for x in naming.files.values() if not x.is_file()):
        raise StictionError(f"{file}: no such file: expected lerobot's calibration")
    return naming


def check_unnamed(where: str, naming: Naming) -> None:
    """Refuse names for a log whose joints have numbers."""
    for option, given in (("joints", naming.joints), ("topic", naming.topic)):
        if given:
            raise StictionError(
                f"{option}: the joints of {where} have numbers: expected a log with names"
            )


def with_held(naming: Naming) -> Naming:
    """Return the naming of a log that has the joints that are held still, too."""
    robot = list(naming.robot)
    for place, name in naming.held:
        robot.insert(place, name)
    return replace(naming, robot=tuple(robot), held=())


def find_joints(
    where: str, names: Sequence[str], n_joints: int | None, naming: Naming
) -> tuple[str, ...]:
    """Return the names in a log of joints 1 to n.

    Args:
        where: the log, the beginning of every message.
        names: all names in the log.
        n_joints: joints of the robot; None where no robot is known: those of the longest series.
        naming: what the caller and the robot say.

    Raises:
        StictionError: names that were given are not in the log, or none can be found.
    """
    if given := naming.joints:
        if len(set(given)) != len(given) or len(given) != (n_joints or len(given)):
            raise StictionError(
                f"joints: {len(set(given))} names: expected {n_joints or 'different ones'}, those "
                "of all the robot's joints from its base"
            )
        for name in given:
            if name not in names:
                raise StictionError(f"{where}: {unknown('joint', name, names)}")
        return given
    if naming.robot and set(naming.robot) <= set(names):
        return naming.robot
    found = _series(names)
    if n_joints is None:
        most = max(map(len, found), default=0)
        found = [s for s in found if len(s) == most] or [tuple(names)]
    else:
        found = [s for s in found if len(s) == n_joints]
    if len(found) == 1:
        return found[0]
    several = [f"{s[0]} to {s[-1]}" for s in found]
    what = f"both {' and '.join(several)}" if several else _short(sorted(names))
    wanted = f"names that are numbered 1 to {n_joints or 'n'}"
    if naming.robot:
        wanted += f", or the robot's ({_short(naming.robot)})"
    raise StictionError(f"{where}: its joints are {what}: expected {wanted}; name the joints")


def joints_in_order(
    where: str, names: Sequence[str], n_joints: int, naming: Naming
) -> tuple[str, ...]:
    """Return joints 1 to n of a log whose joints have a fixed order: as `find_joints`.

    The order counts where there are n joints and nobody names them. A topic is refused.
    """
    if naming.topic is not None:
        raise StictionError(f"topic: {where} has no topics: expected ROS bags only")
    named = naming.joints or (naming.robot and set(naming.robot) <= set(names))
    if not named and len(names) == n_joints:
        return tuple(names)
    return find_joints(where, names, n_joints, naming)


def _series(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return names that differ only in their last number and count from 0 or 1 without a gap."""
    groups: dict[tuple[str, str], dict[int, str]] = {}
    for name in names:
        # the last number of a name counts: robot2_joint1
        *_, match = [None, *re.finditer(r"\d+", name)]
        if match is not None:
            key = name[: match.start()], name[match.end() :]
            groups.setdefault(key, {})[int(match[0])] = name
    return [
        tuple(group[k] for k in sorted(group))
        for group in groups.values()
        if sorted(group) in (list(range(len(group))), list(range(1, len(group) + 1)))
    ]


def _short(names: Sequence[str]) -> str:
    text = ", ".join(names)
    return text if len(text) <= 120 else f"{text[:120].rpartition(', ')[0]} …"
