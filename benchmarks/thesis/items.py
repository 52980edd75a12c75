"""A table or figure of the thesis: what it needs, and what was made of it.

An item asks studies for parts and draws what they found; it simulates nothing. `catalogue` lists
all items, `studies` simulates.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from stiction_envs.measured.csv_text import write_rows
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_small

SHORT = 24
"""Characters of a cell that stays on one line."""
Needs = Mapping[str, Sequence[Hashable]]
"""By study, the parts of it that are needed."""
Found = Mapping[str, Mapping[Any, Any]]
"""By study, what it found for each part."""


@dataclass(frozen=True)
class Table:
    """A table of the thesis with the simulation's numbers."""

    rows: Sequence[Mapping[str, Any]]
    """Lines of the CSV by column, those of the thesis first."""
    header: Sequence[str]
    """Header of the table on the page."""
    shown: Iterable[Sequence[str]]
    """Rows on the page."""
    compared: str
    """How the simulation compares with the thesis."""
    below: str = ""
    """Markdown under the table."""


@dataclass(frozen=True)
class Picture:
    """A figure of the thesis, drawn of simulations."""

    figure: Figure
    compared: str
    """How the simulation compares with the thesis."""


@dataclass(frozen=True)
class Item:
    """A table or a figure of the thesis."""

    kind: str
    """``table`` or ``figure``."""
    id: str
    """As printed: ``4.6``, ``F.1``."""
    title: str
    """What it shows in the thesis, in our words."""
    needs: Needs
    make: Callable[[Found], Table | Picture]

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

    def write(self, found: Found, folder: Path) -> tuple[str, str]:
        """Write the file; return how it compares, and the table or picture as Markdown."""
        path = folder / self.file
        path.parent.mkdir(exist_ok=True)
        made = self.make(found)
        if isinstance(made, Picture):
            save_small(made.figure, path)
            return made.compared, f"![{self.name}: {self.title}]({self.file})"
        write_rows(path, made.rows)
        cells = [
            [x.replace(" ", "\u00a0") if len(x) <= SHORT else x for x in row] for row in made.shown
        ]
        return made.compared, table_text(made.header, cells) + made.below


def needs_of(items: Iterable[Item]) -> dict[str, list[Hashable]]:
    """Return what items need together, each part once."""
    out: dict[str, dict[Hashable, None]] = {}
    for item in items:
        for study, parts in item.needs.items():
            out.setdefault(study, {}).update(dict.fromkeys(parts))
    return {study: list(parts) for study, parts in out.items()}
