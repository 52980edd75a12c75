"""Every table and every figure with data of the thesis, and how its page is made.

    for item in chosen(["4.6", "F.1"]):
        print(item.key)

Table 4.6 and Figure 4.6 share their number: ``4.6`` is both, ``table-4.6`` the one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.thesis import lines, paths, torques
from benchmarks.thesis.items import KINDS, Item, Needs, Write, needs_of
from benchmarks.thesis.ramps import Ramps
from benchmarks.thesis.studies import COST, Options, run_studies
from benchmarks.thesis.torques import ROBOTS, TUNED, torque_needs
from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.html import slug, to_html
from stiction_envs.reporting.markdown import plural, table

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
FUTURE = Path(__file__).with_name("future_work.toml")
TITLE = "The thesis, simulated beside measured"


def _table(number: str, title: str, needs: Callable[[], Needs], write: Write) -> Item:
    return Item(id=number, kind="table", title=title, needs=needs, write=write)


def _figure(number: str, title: str, needs: Callable[[], Needs], write: Write) -> Item:
    return Item(id=number, kind="figure", title=title, needs=needs, write=write)


def _dithered(number: str, title: str) -> Item:
    return _table(number, title, torque_needs(number), torques.write_dithered)


def _ramps(number: str, robot: str, joint: int, dither: str = "none") -> Item:
    name = {OTHER: "iiwa", TUNED: "Panda"}[robot]
    words = {"none": "without dither", "base": "dithered at 100 Hz", "final": "with final dither"}
    ramps = Ramps(robot, joint, dither)
    title = f"Ramps of the {name}'s joint {joint} {words[dither]}, load and no load"
    return _figure(number, title, ramps.needs, ramps.write)


def _errors(number: str, trajectory: str, *, orientation: bool = False) -> Item:
    what = "Orientation" if orientation else "Position"
    return _figure(
        number,
        f"{what} errors along the {trajectory}, mean and spread",
        paths.path_needs(trajectory),
        paths.error_writer(trajectory, orientation=orientation),
    )


ITEMS: tuple[Item, ...] = (
    _figure(
        "2.3",
        "Friction of a joint over its speed, and the parts of it",
        lines.curve_needs,
        lines.write_curve,
    ),
    _table(
        "4.1",
        "Links and friction of the iiwa by RosDyn's least squares (inertias: in the CSV)",
        lines.link_needs,
        lines.write_links,
    ),
    _table(
        "4.2",
        "Lines of friction over speed, Panda joints 1 and 7",
        lines.line_needs,
        lines.write_two_joints,
    ),
    _figure(
        "4.1",
        "Friction over speed and its lines, joints 7 and 1",
        lines.line_needs,
        lines.write_two_panels,
    ),
    _table("4.3", "Base torques, both robots", torque_needs("4.3"), torques.write_base),
    _ramps("4.2", OTHER, 1),
    _ramps("4.3", TUNED, 6),
    _table(
        "4.4",
        "Intercepts of the lines beside base torques, Panda",
        lines.comparison_needs,
        lines.write_comparison,
    ),
    _dithered("4.5", "First trials, iiwa"),
    _ramps("4.4", OTHER, 1, "base"),
    _dithered("4.6", "Frequencies at scale 1.0, Panda"),
    _dithered("4.7", "Scale 1.2, Panda"),
    _dithered("4.8", "Scale 0.8, Panda"),
    _table("4.9", "Chosen settings, Panda", torques.chosen_needs, torques.write_chosen),
    _dithered("4.10", "Verification: intermediate and final amplitudes, Panda"),
    _ramps("4.5", TUNED, 6, "final"),
    _figure(
        "4.6",
        "Triangle and pentagon from above, both stiffnesses",
        paths.path_needs(),
        paths.write_plane,
    ),
    _errors("4.7", "triangle"),
    _errors("4.8", "pentagon"),
    _table(
        "4.11",
        "Sums of the error around the last point",
        paths.sums_needs,
        paths.write_window_sums,
    ),
    _table(
        "A.1",
        "Lines of friction over speed, all joints of the Panda",
        lines.line_needs,
        lines.write_all_joints,
    ),
    _figure(
        "A.1",
        "Friction over speed and its lines, all joints",
        lines.line_needs,
        lines.write_seven_panels,
    ),
    *(_ramps(f"B.{joint}", OTHER, joint) for joint in range(1, 8)),
    *(_ramps(f"C.{joint}", TUNED, joint) for joint in range(1, 8)),
    *(_ramps(f"D.{joint}", TUNED, joint, "final") for joint in range(1, 8)),
    _figure(
        "E.1",
        "Triangle and pentagon in space, both stiffnesses",
        paths.path_needs(),
        paths.write_space,
    ),
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
    drawing = COST["drawing"] * len(items)

    def simulated(stage: str, done: float, total: float) -> None:
        tell(stage, done / (total + drawing))

    found, total = run_studies(needs_of(items), options, simulated)
    sections: dict[str, list[str]] = {}
    out, overview = {}, []
    for k, item in enumerate(items):
        tell("drawing", (total + k * COST["drawing"]) / (total + drawing))
        written = item.write(item, found, folder)
        brief, sentence = written.numbers
        file = f"As numbers: [{item.file}]({item.file})" if item.kind == "table" else ""
        if "†" in written.body:
            file += "\n\n† not credible: the same setting repeated in Table 4.10 gives +1.65 %."
        heading = f"### {item.name}"
        section = [heading, f"{item.title}.", sentence, written.body, file]
        sections.setdefault(item.id.split(".")[0], []).append("\n\n".join(filter(None, section)))
        overview.append([f"[{item.name}](#{slug(item.name)})", item.title, brief])
        values = {"title": item.title, "brief": brief, "sentence": sentence, "file": item.file}
        out[item.key] = values
    chapters = [f"## {CHAPTERS[c]}\n\n" + "\n\n".join(x) + "\n" for c, x in sections.items()]
    tables = table(["", "what it shows", "simulated against the thesis"], overview)
    parts = [*_head(items, options), *tables, *chapters, *_future()]
    if len(items) == len(ITEMS):
        parts += ["## Left out", "", "Without data, and not drawn:", ""]
        parts += [f"- {name}: {why}" for name, why in LEFT_OUT.items()]
    text = "\n".join(parts).rstrip("\n") + "\n"
    write_text_atomic(folder / "report.md", text)
    write_text_atomic(folder / "index.html", to_html(text.splitlines(), folder, TITLE))
    tell("drawing", 1.0)
    return out


def _head(items: Sequence[Item], options: Options) -> list[str]:
    count = sum(item.kind == "table" for item in items)
    repeats = options.iterations
    iterations = plural(repeats, "iteration") if repeats else "as many iterations as in the thesis"
    return [
        f"# {TITLE}",
        "",
        f"{plural(count, 'table')} and {plural(len(items) - count, 'figure')} of {len(ITEMS)} with "
        'data of S. Monzó Martínez, A. Zejnullahu, "Accuracy Improvement and Joint Stiction '
        "Relieve in Robot Arms Movement Applying Torque-Based Cartesian Impedance Control With "
        'Dithering", MSc thesis TFRT-6202, Lund University, 2023. What came of its wishes: '
        "[future work](#future-work).",
        "",
        f"- **Simulated** is with the friction shipped for both arms, {iterations}, seed "
        f"{options.seed}{'' if options.scatter else ', without scatter'}.",
        "- Differences are simulated less measured: of torques in per cent, of changes by dither "
        "in points of the base torque.",
        "- Lines and links are fitted to simulated logs whose friction is known: **simulated** "
        "with noise, lag, no slow data and a hand that the model does not know, **nothing wrong** "
        "without any of these.",
        "- Every table is a CSV with the thesis's columns first; misprints are as printed "
        "(`stiction_envs/measured/thesis/README.md`).",
        "",
        "## In short",
        "",
    ]


def wishes() -> list[dict[str, Any]]:
    """Return what section 6.1 wished for, with numbers and their sources."""
    found: list[dict[str, Any]] = tomllib.loads(FUTURE.read_text(encoding="utf-8"))["wishes"]
    return found


def _future() -> list[str]:
    rows = []
    for w in wishes():
        numbers = [f"{n['what']}: **{n['value']}** (`{n['source']}`)" for n in w["numbers"]]
        rows.append([w["wish"], f"{w['answer']}: `{w['command']}`", "; ".join(numbers)])
    return [
        "## Future work",
        "",
        "What section 6.1 of the thesis wished for, and what this project answers with. Numbers "
        "are those of the studies named beside them, made earlier and not by this run.",
        "",
        *table(["wish", "answer", "number"], rows),
    ]
