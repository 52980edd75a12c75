"""Every table and every figure with data of the thesis, and how its page is made.

    for item in chosen(["4.6", "F.1"]):
        print(item.key)

Table 4.6 and Figure 4.6 share their number: ``4.6`` is both, ``table-4.6`` the one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.thesis import lines, paths, torques
from benchmarks.thesis.items import KINDS, Item, needs_of
from benchmarks.thesis.ramps import Ramps
from benchmarks.thesis.studies import Options, run_studies
from benchmarks.thesis.torques import ROBOTS, TUNED, torque_needs
from stiction_envs.errors import StictionError
from stiction_envs.reporting.html import slug
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.templates import write_md_and_html

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
HERE = Path(__file__).parent
TITLE = "The thesis, simulated beside measured"
DRAWING_S = 0.4
"""Time to draw an item, measured roughly [s]."""
_table, _figure = partial(Item, "table"), partial(Item, "figure")


def _dithered(number: str, title: str) -> Item:
    return _table(number, title, torque_needs(number), torques.write_dithered)


def _ramps(number: str, robot: str, joint: int, dither: str = "none") -> Item:
    name = {OTHER: "iiwa", TUNED: "Panda"}[robot]
    words = {"none": "without dither", "base": "dithered at 100 Hz", "final": "with final dither"}
    ramps = Ramps(robot, joint, dither)
    title = f"Ramps of the {name}'s joint {joint} {words[dither]}, load and no load"
    return _figure(number, title, ramps.needs, ramps.write)


def _errors(number: str, trajectory: str, *, orientation: bool = False) -> Item:
    title = f"{'Orientation' if orientation else 'Position'} errors along the {trajectory}"
    write = paths.error_writer(trajectory, orientation=orientation)
    return _figure(number, f"{title}, mean and spread", paths.path_needs(trajectory), write)


LINKS = "Links and friction of the iiwa by RosDyn's least squares (inertias: in the CSV)"
CURVE = "Friction of a joint over its speed, and the parts of it"
INTERCEPTS = "Intercepts of the lines beside base torques, Panda"
CHECKED = "Verification: intermediate and final amplitudes, Panda"
ALL_LINES, LINES = "Lines of friction over speed", "Friction over speed and its lines"
SUMS = "Sums of the error around the last point"
PLANE, SPACE = (f"Triangle and pentagon {x}, both stiffnesses" for x in ("from above", "in space"))
ITEMS: tuple[Item, ...] = (
    _figure("2.3", CURVE, lines.curve_needs, lines.write_curve),
    _table("4.1", LINKS, lines.link_needs, lines.write_links),
    _table("4.2", f"{ALL_LINES}, Panda joints 1 and 7", lines.line_needs, lines.write_two_joints),
    _figure("4.1", f"{LINES}, joints 7 and 1", lines.line_needs, lines.write_two_panels),
    _table("4.3", "Base torques, both robots", torque_needs("4.3"), torques.write_base),
    _ramps("4.2", OTHER, 1),
    _ramps("4.3", TUNED, 6),
    _table("4.4", INTERCEPTS, lines.comparison_needs, lines.write_comparison),
    _dithered("4.5", "First trials, iiwa"),
    _ramps("4.4", OTHER, 1, "base"),
    _dithered("4.6", "Frequencies at scale 1.0, Panda"),
    _dithered("4.7", "Scale 1.2, Panda"),
    _dithered("4.8", "Scale 0.8, Panda"),
    _table("4.9", "Chosen settings, Panda", torques.chosen_needs, torques.write_chosen),
    _dithered("4.10", CHECKED),
    _ramps("4.5", TUNED, 6, "final"),
    _figure("4.6", PLANE, paths.path_needs(), paths.write_plane),
    _errors("4.7", "triangle"),
    _errors("4.8", "pentagon"),
    _table("4.11", SUMS, paths.path_needs(), paths.write_window_sums),
    _table("A.1", f"{ALL_LINES}, all joints, Panda", lines.line_needs, lines.write_all_joints),
    _figure("A.1", f"{LINES}, all joints", lines.line_needs, lines.write_seven_panels),
    *(_ramps(f"B.{joint}", OTHER, joint) for joint in range(1, 8)),
    *(_ramps(f"C.{joint}", TUNED, joint) for joint in range(1, 8)),
    *(_ramps(f"D.{joint}", TUNED, joint, "final") for joint in range(1, 8)),
    _figure("E.1", SPACE, paths.path_needs(), paths.write_space),
    _errors("F.1", "triangle", orientation=True),
    _errors("F.2", "pentagon", orientation=True),
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
            raise StictionError(f"unknown table or figure {name!r}: expected one of {_all_ids()}")
    return tuple(x for x in ITEMS if not ids or x.id in ids or x.key in ids)


def _all_ids() -> str:
    """Return all ids in short: ``tables 4.1 to 4.11 and A.1; figures 2.3, …``."""
    parts = []
    for kind in KINDS:
        numbers: dict[str, list[int]] = {}
        for chapter, number in (item.id.split(".") for item in ITEMS if item.kind == kind):
            numbers.setdefault(chapter, []).append(int(number))
        ends = [
            f"{c}.{min(n)} to {c}.{max(n)}" if len(n) > 1 else f"{c}.{n[0]}"
            for c, n in numbers.items()
        ]
        parts.append(f"{kind}s {', '.join(ends)}")
    return "; ".join(parts) + " (table-4.6 is one of two)"


def reproduce(
    items: Sequence[Item],
    folder: Path,
    options: Options,
    tell: Callable[[str, float], None] = lambda *_: None,
) -> dict[str, dict[str, str]]:
    """Simulate and draw items and write their page; an interrupted call goes on.

    Args:
        items: in the order of the thesis.
        folder: where; it exists.
        options: of the studies.
        tell: called with what is being done, and the share of all that is done [0 to 1].

    Returns:
        Title, number, sentence and file by item.
    """
    drawing = DRAWING_S * len(items)
    found, total = run_studies(
        needs_of(items), options, lambda stage, done, of: tell(stage, done / (of + drawing))
    )
    chapters: dict[str, list[Any]] = {}
    out, overview = {}, []
    for k, item in enumerate(items):
        tell("drawing", (total + k * DRAWING_S) / (total + drawing))
        written = item.write(item, found, folder)
        brief, sentence = written.numbers
        chapters.setdefault(CHAPTERS[item.id.split(".")[0]], []).append((item, written))
        overview.append([f"[{item.name}](#{slug(item.name)})", item.title, brief])
        values = {"title": item.title, "brief": brief, "sentence": sentence, "file": item.file}
        out[item.key] = values
    tables = sum(item.kind == "table" for item in items)
    write_md_and_html(
        folder,
        HERE / "report.md.j2",
        TITLE,
        ("report.md", "index.html"),
        tables=tables,
        figures=len(items) - tables,
        all=len(ITEMS),
        options=options,
        overview=table_text(["", "what it shows", "simulated against the thesis"], overview),
        chapters=chapters,
        future=_future(),
        left_out=LEFT_OUT,
    )
    tell("drawing", 1.0)
    return out


def wishes() -> list[dict[str, Any]]:
    """Return what section 6.1 wished for, with numbers and their sources."""
    text = (HERE / "future_work.toml").read_text(encoding="utf-8")
    found: list[dict[str, Any]] = tomllib.loads(text)["wishes"]
    return found


def _future() -> str:
    rows = []
    for w in wishes():
        numbers = [f"{n['what']}: **{n['value']}** (`{n['source']}`)" for n in w["numbers"]]
        rows.append([w["wish"], f"{w['answer']}: `{w['command']}`", "; ".join(numbers)])
    return table_text(["wish", "answer", "number"], rows)
