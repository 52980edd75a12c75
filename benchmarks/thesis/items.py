"""What a table or figure of the thesis is made of: its needs, its file, its one sentence.

An item asks studies for parts and draws what they found; it simulates nothing. `catalogue` lists
all items, `studies` simulates.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_small

KINDS = ("table", "figure")
SHORT = 24
"""Characters of a cell that stays on one line."""
Needs = Mapping[str, Sequence[Hashable]]
"""By study, the parts of it that are needed."""
Found = Mapping[str, Mapping[Any, Any]]
"""By study, what it found for each part."""
Numbers = tuple[str, str]
"""The number that counts, and one sentence of how the simulation compares with the thesis."""


@dataclass(frozen=True)
class Written:
    """What an item says and shows."""

    numbers: Numbers
    body: str
    """Markdown: tables and pictures."""


@dataclass(frozen=True)
class Item:
    """A table or a figure of the thesis."""

    kind: str
    """One of :data:`KINDS`."""
    id: str
    """As printed: ``4.6``, ``F.1``."""
    title: str
    """What it shows in the thesis, in our words."""
    needs: Callable[[], Needs]
    write: Callable[[Item, Found, Path], Written]
    """Draws into the folder what the studies found."""

    @property
    def key(self) -> str:
        """``table-4.6``, ``figure-F.1``."""
        return f"{self.kind}-{self.id}"

    @property
    def name(self) -> str:
        """``Table 4.6``, ``Figure F.1``."""
        return f"{self.kind.capitalize()} {self.id}"

    @property
    def file(self) -> str:
        """``tables/table_4_6.csv``, ``figures/figure_F_1.png``."""
        stem = f"{self.kind}_{self.id.replace('.', '_')}"
        return f"{self.kind}s/{stem}.{'csv' if self.kind == 'table' else 'png'}"


Write = Callable[[Item, Found, Path], Written]


def needs_of(items: Iterable[Item]) -> dict[str, list[Hashable]]:
    """Return what items need together, each part once."""
    out: dict[str, dict[Hashable, None]] = {}
    for item in items:
        for study, parts in item.needs().items():
            out.setdefault(study, {}).update(dict.fromkeys(parts))
    return {study: list(parts) for study, parts in out.items()}


def write_table(
    item: Item,
    folder: Path,
    *,
    columns: Sequence[str],
    rows: Sequence[Sequence[Any]],
    header: Sequence[str],
    shown: Iterable[Sequence[str]],
    numbers: Numbers,
) -> Written:
    """Write a table's CSV.

    Args:
        item: the table.
        folder: where.
        columns: of the CSV, those of the thesis first.
        rows: of the CSV.
        header: of the table on the page.
        shown: its rows there; short cells are not broken.
        numbers: how it compares.
    """
    path = folder / item.file
    path.parent.mkdir(exist_ok=True)
    write_lines(path, columns, rows)
    cells = [[x.replace(" ", "\u00a0") if len(x) <= SHORT else x for x in row] for row in shown]
    return Written(numbers, table_text(header, cells))


def write_figure(item: Item, folder: Path, figure: Figure, numbers: Numbers) -> Written:
    """Write a figure's picture."""
    path = folder / item.file
    path.parent.mkdir(exist_ok=True)
    save_small(figure, path)
    return Written(numbers, f"![{item.name}: {item.title}]({item.file})")
