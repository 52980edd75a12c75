"""Every table and every figure with data of the thesis, and which study each one asks.

    for item in chosen(["4.6", "F.1"]):
        print(item.key, item.study)

Table 4.6 and Figure 4.6 share their number: ``4.6`` is both, ``table-4.6`` the one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from stiction_envs.errors import StictionError
from stiction_envs.thesis.items import KINDS, Item, Needs, Write
from stiction_envs.thesis.items_friction import curve_needs, write_curve
from stiction_envs.thesis.items_lines import (
    comparison_needs,
    line_needs,
    link_needs,
    write_all_joints,
    write_comparison,
    write_links,
    write_seven_panels,
    write_two_joints,
    write_two_panels,
)
from stiction_envs.thesis.items_paths import (
    error_writer,
    path_needs,
    sums_needs,
    write_plane,
    write_space,
    write_window_sums,
)
from stiction_envs.thesis.items_ramps import Ramps, ramp_item
from stiction_envs.thesis.items_torques import (
    chosen_needs,
    torque_needs,
    write_base,
    write_chosen,
    write_dithered,
)
from stiction_envs.thesis.tables import ROBOTS, TITLES, TUNED

(OTHER,) = (robot for robot in ROBOTS if robot != TUNED)
CHAPTERS = {
    "2": "Background",
    "4": "Results",
    "A": "Appendix A: friction over speed",
    "B": "Appendix B: Single Joint Experiment, iiwa",
    "C": "Appendix C: Single Joint Experiment, Panda",
    "D": "Appendix D: Single Joint Experiment with the final dither, Panda",
    "E": "Appendix E: paths in space",
    "F": "Appendix F: orientation errors",
}
"""Headings of the page by the first part of an item's id."""
LEFT_OUT = {
    "Figure 1.1": "a photograph of the arms",
    "Figure 2.1": "a sketch of a serial manipulator",
    "Figure 2.2": "a block diagram of the controller",
    "Figures 3.1, 3.2 and 3.4": "photographs and screenshots of the set-ups",
    "Figures 3.3 and 3.5": "flow charts of the two experiments",
}
"""What has no data, and is not drawn."""


def _table(number: str, title: str, needs: Callable[[], Needs], write: Write) -> Item:
    return Item(id=number, kind="table", title=title, needs=needs, write=write)


def _figure(number: str, title: str, needs: Callable[[], Needs], write: Write) -> Item:
    return Item(id=number, kind="figure", title=title, needs=needs, write=write)


def _torques(number: str) -> Item:
    write = write_base if number == "4.3" else write_dithered
    return _table(number, TITLES[number], torque_needs(number), write)


def _appendix(letter: str, robot: str, name: str, dither: str) -> list[Item]:
    words = "with the final dither" if dither == "final" else "without dither"
    return [
        ramp_item(
            f"{letter}.{joint}",
            f"Ramps of the {name}'s joint {joint} {words}, load and no load",
            Ramps(robot, joint, dither),
        )
        for joint in range(1, 8)
    ]


ITEMS: tuple[Item, ...] = (
    _figure(
        "2.3", "Friction of a joint over its speed, and the parts of it", curve_needs, write_curve
    ),
    _table(
        "4.1",
        "Links and friction of the iiwa by RosDyn's least squares (inertias: in the CSV)",
        link_needs,
        write_links,
    ),
    _table(
        "4.2", "Lines of friction over speed, Panda joints 1 and 7", line_needs, write_two_joints
    ),
    _figure(
        "4.1", "Friction over speed and its lines, joints 7 and 1", line_needs, write_two_panels
    ),
    _torques("4.3"),
    ramp_item("4.2", "Ramps of the iiwa's joint 1 without dither", Ramps(OTHER, 1, "none")),
    ramp_item("4.3", "Ramps of the Panda's joint 6 without dither", Ramps(TUNED, 6, "none")),
    _table(
        "4.4",
        "Intercepts of the lines beside base torques, Panda",
        comparison_needs,
        write_comparison,
    ),
    _torques("4.5"),
    ramp_item("4.4", "Ramps of the iiwa's joint 1, dithered at 100 Hz", Ramps(OTHER, 1, "base")),
    _torques("4.6"),
    _torques("4.7"),
    _torques("4.8"),
    _table("4.9", TITLES["4.9"], chosen_needs, write_chosen),
    _torques("4.10"),
    ramp_item(
        "4.5", "Ramps of the Panda's joint 6 with the final dither", Ramps(TUNED, 6, "final")
    ),
    _figure("4.6", "Triangle and pentagon from above, both stiffnesses", path_needs(), write_plane),
    _figure(
        "4.7",
        "Position errors along the triangle, mean and spread",
        path_needs("triangle"),
        error_writer("triangle"),
    ),
    _figure(
        "4.8",
        "Position errors along the pentagon, mean and spread",
        path_needs("pentagon"),
        error_writer("pentagon"),
    ),
    _table("4.11", "Sums of the error around the last point", sums_needs, write_window_sums),
    _table(
        "A.1", "Lines of friction over speed, all joints of the Panda", line_needs, write_all_joints
    ),
    _figure("A.1", "Friction over speed and its lines, all joints", line_needs, write_seven_panels),
    *_appendix("B", OTHER, "iiwa", "none"),
    *_appendix("C", TUNED, "Panda", "none"),
    *_appendix("D", TUNED, "Panda", "final"),
    _figure("E.1", "Triangle and pentagon in space, both stiffnesses", path_needs(), write_space),
    _figure(
        "F.1",
        "Orientation errors along the triangle, mean and spread",
        path_needs("triangle"),
        error_writer("triangle", orientation=True),
    ),
    _figure(
        "F.2",
        "Orientation errors along the pentagon, mean and spread",
        path_needs("pentagon"),
        error_writer("pentagon", orientation=True),
    ),
)
"""In the order of the thesis."""


def chosen(ids: Sequence[str]) -> tuple[Item, ...]:
    """Return items by id, in the order of the thesis, each once; none for all.

    Args:
        ids: ``4.6`` for a table and a figure, ``table-4.6`` for one of them.

    Raises:
        StictionError: no such item.
    """
    for name in ids:
        if not any(name in (item.id, item.key) for item in ITEMS):
            raise StictionError(f"unknown table or figure {name!r}: expected one of {_spans()}")
    return tuple(x for x in ITEMS if not ids or x.id in ids or x.key in ids)


def _spans() -> str:
    """Return all ids in short: ``tables 4.1 to 4.11 and A.1; figures 2.3, …``."""
    parts = []
    for kind in KINDS:
        numbers: dict[str, list[int]] = {}
        for item in ITEMS:
            if item.kind == kind:
                chapter, number = item.id.split(".")
                numbers.setdefault(chapter, []).append(int(number))
        spans = [
            f"{c}.{min(n)} to {c}.{max(n)}" if len(n) > 1 else f"{c}.{n[0]}"
            for c, n in numbers.items()
        ]
        parts.append(f"{kind}s {', '.join(spans)}")
    return "; ".join(parts) + " (table-4.6 is one of two)"
