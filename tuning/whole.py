"""The whole thesis in one folder, or some of its tables and figures.

    reproduce_items(["4.6", "F.1"], "runs/some")

`stiction_envs.thesis.catalogue` lists them, `studies` runs what they need.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.thesis.catalogue import chosen
from stiction_envs.thesis.items import Item, needs_of
from stiction_envs.thesis.settings import thesis_settings
from stiction_envs.thesis.whole_page import Section, write_pages
from tuning.reproduce import Request
from tuning.studies import FOLDER, NAMES, STUDIES, Setting

if TYPE_CHECKING:
    from stiction_envs.reporting.output_folder import OutputFolder

Share = Callable[[str, float], None]
"""Progress: what is being done, share of the whole that is done [0 to 1]."""


def reproduce_items(
    only: Sequence[str],
    out: str | Path | OutputFolder,
    request: Request | None = None,
    *,
    tell: Share = lambda *_: None,
) -> dict[str, Any]:
    """Simulate and draw; an interrupted call goes on.

    Args:
        only: ids of items; none for all.
        out: the folder.
        request: how; None for the defaults.
        tell: of progress.

    Returns:
        Sentences and files by item.

    Raises:
        StictionError: no such item, or an output folder of another run; nothing was written.
    """
    from stiction_envs.reporting.output_folder import OutputFolder
    from stiction_envs.reporting.provenance import provenance

    request = Request() if request is None else request
    items = chosen(only)
    if not isinstance(out, OutputFolder):
        made = {
            "only": [item.key for item in items],
            "iterations": request.iterations,
            "no_scatter": not request.scatter,
        }
        found = provenance("reproduce", made, seed=request.seed, inputs=inputs_of_items(items))
        out = OutputFolder(Path(out), found, resumable=True)
    with out:
        sections = _sections(items, out.path, request, tell)
        write_pages(
            out.path,
            sections,
            seed=request.seed,
            iterations=request.iterations,
            scatter=request.scatter,
        )
    return {
        s.item.key: {
            "title": s.item.title,
            "brief": s.written.said.brief,
            "sentence": s.written.said.sentence,
            "file": s.item.file,
        }
        for s in sections
    }


def _sections(items: Sequence[Item], folder: Path, request: Request, tell: Share) -> list[Section]:
    how = Setting(
        seed=request.seed,
        iterations=request.iterations,
        scatter=request.scatter,
        nthread=request.nthread,
        folder=folder / FOLDER,
    )
    needs, cost = needs_of(items), thesis_settings().cost
    parts = {name: needs[name] for name in STUDIES if name in needs}
    costs = {name: STUDIES[name].cost(mine, how) for name, mine in parts.items()}
    drawing = cost.drawing * len(items)
    total = sum(costs.values()) + drawing
    found: dict[str, dict[Any, Any]] = {}
    before = 0.0
    for name, mine in parts.items():
        done = 0.0

        def advance(seconds: float, name: str = name, before: float = before) -> None:
            nonlocal done
            done += seconds
            # estimates may be passed; the next study starts where this one was to end
            tell(NAMES[name], (before + min(done, costs[name])) / total)

        tell(NAMES[name], before / total)
        found[name] = STUDIES[name].run(mine, found, how, advance)
        before += costs[name]
    sections = []
    for k, item in enumerate(items):
        tell("drawing", (before + k * cost.drawing) / total)
        sections.append(Section(item, item.write(item, found, folder)))
    tell("drawing", 1.0)
    return sections


def inputs_of_items(items: Sequence[Item]) -> dict[str, Path]:
    """Return the files items depend on: arms, friction, settings, measured tables."""
    from stiction_envs.friction.parameters import friction_path
    from stiction_envs.measured import thesis_robots
    from stiction_envs.measured.thesis_tables import THESIS_TABLES
    from stiction_envs.reporting.provenance import package_folder
    from stiction_envs.robots.files import robot_files

    package = package_folder()
    studies = set(needs_of(items))
    found: dict[str, Path] = {"thesis_settings": package / "thesis" / "settings.toml"}
    for robot in thesis_robots():
        files = robot_files(robot)
        found[robot], found[f"{robot}_table"] = files["robot"], files["robot_table"]
        found[f"{robot}_friction"] = friction_path(robot)
    if studies & {"sje", "choice"}:
        found["protocol"] = package / "experiments" / "sje" / "sje.toml"
    if "gte" in studies:
        found["gte_protocol"] = package / "experiments" / "gte" / "gte.toml"
        found["controller"] = package / "control" / "gte.toml"
    if "ensemble" in studies:
        found["ensemble"] = package / "thesis" / "ensemble.toml"
    for number in THESIS_TABLES:
        name = f"table_{number.replace('.', '_')}"
        found[name] = package / "measured" / "thesis" / f"{name}.csv"
    return found
