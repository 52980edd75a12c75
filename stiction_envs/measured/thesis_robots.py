"""The thesis's two arms: their names in print, and the tables that have them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ThesisRobot:
    """An arm that the thesis measured."""

    name: str
    """Our name."""
    title: str
    """In headings about the thesis."""
    tables: tuple[str, ...]
    """Numbers of the tables that have it."""
    weight_kg: float | None = None
    """Weight in the vendor's data sheet [kg], where the thesis prints masses."""


_ROBOTS = (
    ThesisRobot(
        name="panda",
        title="Panda",
        tables=("4.2", "4.3", "4.4", "4.6", "4.7", "4.8", "4.9", "4.10", "4.11", "A.1"),
    ),
    ThesisRobot(
        name="iiwa7",
        title="iiwa",
        tables=("4.1", "4.3", "4.5"),
        weight_kg=23.9,
    ),
)


def thesis_robots(table: str | None = None) -> dict[str, ThesisRobot]:
    """Return the arms of the thesis by our name, or only those that one of its tables has."""
    return {r.name: r for r in _ROBOTS if table is None or table in r.tables}


def our_name(robot: str) -> str:
    """Our name of a robot: the thesis's ``iiwa`` is the iiwa 7 R800; others keep theirs."""
    return "iiwa7" if robot == "iiwa" else robot
