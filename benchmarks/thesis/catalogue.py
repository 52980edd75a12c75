"""Every table and every figure with data of the thesis, and how its page is made.

    for item in chosen(["4.6", "F.1"]):
        print(item.key)

Table 4.6 and Figure 4.6 share their number: ``4.6`` is both, ``table-4.6`` the one.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.thesis import lines, paths, torques
from benchmarks.thesis.items import Item, needs_of
from benchmarks.thesis.ramps import Ramps
from benchmarks.thesis.studies import Options, Tell, run_studies
from benchmarks.thesis.torques import ROBOTS, TUNED, torque_needs
from stiction_envs.errors import unknown
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
HERE = Path(__file__).parent
TITLE = "The thesis, simulated beside measured"
_table, _figure = partial(Item, "table"), partial(Item, "figure")


def _dithered(number: str, title: str) -> Item:
    return _table(number, title, torque_needs(number), partial(torques.dithered_table, number))


def _ramps(number: str, robot: str, joint: int, dither: str = "none") -> Item:
    name = {OTHER: "iiwa", TUNED: "Panda"}[robot]
    words = {"none": "without dither", "base": "dithered at 100 Hz", "final": "with final dither"}
    ramps = Ramps(robot, joint, dither)
    title = f"Ramps of the {name}'s joint {joint} {words[dither]}, load and no load"
    return _figure(number, title, ramps.needs(), ramps.picture)


def _errors(number: str, trajectory: str, *, orientation: bool = False) -> Item:
    title = f"{'Orientation' if orientation else 'Position'} errors along the {trajectory}"
    draw = partial(paths.error_figure, trajectory, orientation)
    return _figure(number, f"{title}, mean and spread", paths.path_needs(trajectory), draw)


LINKS = "Links and friction of the iiwa by RosDyn's least squares (inertias: in the CSV)"
CURVE = "Friction of a joint over its speed, and the parts of it"
INTERCEPTS = "Intercepts of the lines beside base torques, Panda"
CHECKED = "Verification: intermediate and final amplitudes, Panda"
ALL_LINES, LINES = "Lines of friction over speed", "Friction over speed and its lines"
SUMS = "Sums of the error around the last point"
PLANE, SPACE = (f"Triangle and pentagon {x}, both stiffnesses" for x in ("from above", "in space"))
ITEMS: tuple[Item, ...] = (
    _figure("2.3", CURVE, lines.CURVE_NEEDS, lines.figure_2_3),
    _table("4.1", LINKS, lines.LINK_NEEDS, lines.table_4_1),
    _table("4.2", f"{ALL_LINES}, Panda joints 1 and 7", lines.LINE_NEEDS, lines.table_4_2),
    _figure("4.1", f"{LINES}, joints 7 and 1", lines.LINE_NEEDS, lines.figure_4_1),
    _table("4.3", "Base torques, both robots", torque_needs("4.3"), torques.table_4_3),
    _ramps("4.2", OTHER, 1),
    _ramps("4.3", TUNED, 6),
    _table("4.4", INTERCEPTS, lines.COMPARISON_NEEDS, lines.table_4_4),
    _dithered("4.5", "First trials, iiwa"),
    _ramps("4.4", OTHER, 1, "base"),
    _dithered("4.6", "Frequencies at scale 1.0, Panda"),
    _dithered("4.7", "Scale 1.2, Panda"),
    _dithered("4.8", "Scale 0.8, Panda"),
    _table("4.9", "Chosen settings, Panda", torque_needs("4.9"), torques.table_4_9),
    _dithered("4.10", CHECKED),
    _ramps("4.5", TUNED, 6, "final"),
    _figure("4.6", PLANE, paths.path_needs(), paths.figure_4_6),
    _errors("4.7", "triangle"),
    _errors("4.8", "pentagon"),
    _table("4.11", SUMS, paths.path_needs(), paths.table_4_11),
    _table("A.1", f"{ALL_LINES}, all joints, Panda", lines.LINE_NEEDS, lines.table_a_1),
    _figure("A.1", f"{LINES}, all joints", lines.LINE_NEEDS, lines.figure_a_1),
    *(_ramps(f"B.{joint}", OTHER, joint) for joint in range(1, 8)),
    *(_ramps(f"C.{joint}", TUNED, joint) for joint in range(1, 8)),
    *(_ramps(f"D.{joint}", TUNED, joint, "final") for joint in range(1, 8)),
    _figure("E.1", SPACE, paths.path_needs(), paths.figure_e_1),
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
            raise unknown("table or figure", name, dict.fromkeys(item.id for item in ITEMS))
    return tuple(x for x in ITEMS if not ids or x.id in ids or x.key in ids)


def reproduce(
    items: Sequence[Item], folder: Path, options: Options, tell: Tell
) -> dict[str, dict[str, str]]:
    """Simulate and draw items and write their page.

    Args:
        items: in the order of the thesis.
        folder: where; it exists.
        options: of the studies.
        tell: called with what is being done, how many parts of it are, and how many there are.

    Returns:
        Title, comparison and file by item.
    """
    found = run_studies(needs_of(items), options, tell)
    chapters: dict[str, list[Any]] = {}
    out, overview = {}, []
    for k, item in enumerate(items):
        tell("drawing", k, len(items))
        compared, body = item.write(found, folder)
        chapters.setdefault(CHAPTERS[item.id.split(".")[0]], []).append((item, compared, body))
        overview.append([f"[{item.name}](#{slug(item.name)})", item.title, compared])
        out[item.key] = {"title": item.title, "compared": compared, "file": item.file}
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
    )
    return out
