"""The page of the whole thesis: `report.md`, and `index.html`, which needs nothing else.

The words are in ``templates/whole.md.j2``; what section 6.1 wished for is in
``templates/future.toml``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction_envs.reporting.html import slug
from stiction_envs.reporting.markdown import plural, table_text
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.thesis.catalogue import CHAPTERS, ITEMS, LEFT_OUT
from stiction_envs.thesis.items import TEMPLATES, Item, Written

FILES = ("index.html", "report.md")
"""What `write_pages` writes."""


@dataclass(frozen=True)
class Section:
    """An item and what it has written."""

    item: Item
    written: Written


@dataclass(frozen=True)
class Chapter:
    """A heading and the sections under it."""

    title: str
    sections: Sequence[Section]


def write_pages(
    folder: Path,
    sections: Sequence[Section],
    *,
    seed: int,
    iterations: int | None,
    scatter: bool,
) -> None:
    """Write both pages.

    Args:
        folder: where the items have written their files.
        sections: in the order of the thesis.
        seed: of the run.
        iterations: repeats; None for the thesis's.
        scatter: whether iterations differ.
    """
    chapters = []
    for letter, title in CHAPTERS.items():
        mine = [s for s in sections if s.item.id.split(".")[0] == letter]
        if mine:
            chapters.append(Chapter(title, mine))
    whole = len(sections) == len(ITEMS)
    write_md_and_html(
        folder,
        TEMPLATES / "whole.md.j2",
        "The thesis, simulated beside measured",
        ("report.md", "index.html"),
        intro=_intro(sections, whole=whole),
        iterations="as many iterations as in the thesis"
        if iterations is None
        else plural(iterations, "iteration"),
        seed=seed,
        scatter=scatter,
        lines=any("lsm" in s.item.study for s in sections),
        overview=_overview(sections),
        chapters=chapters,
        future=future_table(),
        left_out=LEFT_OUT if whole else {},
    )


def _intro(sections: Sequence[Section], *, whole: bool) -> str:
    tables = sum(s.item.kind == "table" for s in sections)
    figures = len(sections) - tables
    what = f"{plural(tables, 'table')} and {plural(figures, 'figure')}"
    part = "every one with data" if whole else f"of {len(ITEMS)} with data"
    return (
        f'{what} ({part}) of S. Monzó Martínez, A. Zejnullahu, "Accuracy Improvement and Joint '
        "Stiction Relieve in Robot Arms Movement Applying Torque-Based Cartesian Impedance Control "
        'With Dithering", MSc thesis TFRT-6202, Lund University, 2023. What came of its wishes: '
        "[future work](#future)."
    )


def _overview(sections: Sequence[Section]) -> str:
    rows = [
        [f"[{s.item.name}](#{slug(s.item.name)})", s.item.title, s.written.said.brief]
        for s in sections
    ]
    return table_text(["", "what it shows", "simulated against the thesis"], rows)


# ---- section 6.1 ---------------------------------------------------------------------------------


def wishes() -> list[dict[str, Any]]:
    """Return what section 6.1 wished for, with numbers and their sources."""
    text = (TEMPLATES / "future.toml").read_text(encoding="utf-8")
    found: list[dict[str, Any]] = tomllib.loads(text)["wishes"]
    return found


def future_table() -> str:
    """Return the wishes as a table."""
    rows = []
    for w in wishes():
        numbers = [f"{n['what']}: **{n['value']}** (`{n['source']}`)" for n in w["numbers"]]
        rows.append(
            [
                w["wish"],
                f"{w['answer']}: `{w['command']}`",
                "; ".join(numbers) or "no number is known",
            ]
        )
    return table_text(["wish", "answer", "number"], rows)
