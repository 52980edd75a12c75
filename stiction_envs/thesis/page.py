"""The page of the nested models: `gap.md`, `ladder.md`, their tables, numbers and pictures.

write_page(folder, nested.models, study=study_phase())

The words are written by hand in ``templates/gap.md.j2``, about the fit that is shipped in
``benchmarks/thesis_ladder``; every number in them, and every table, comes from the models given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.gap.tables.cells import Cell, cells
from stiction_envs.reporting import templates
from stiction_envs.thesis import figures
from stiction_envs.thesis.nested_models import NestedModel
from stiction_envs.thesis.nyquist_phase import PhaseStudy
from stiction_envs.thesis.page_numbers import numbers
from stiction_envs.thesis.scores import JOINTS, ModelScores

TEMPLATES = Path(__file__).parent / "templates"
FILES = (
    "gap.md",
    "ladder.md",
    "ladder.png",
    "residuals.png",
    *(f"joint_{j}.png" for j in JOINTS),
    "iiwa.png",
)
"""What `write_page` writes."""


def write_page(
    folder: Path,
    models: Mapping[str, NestedModel],
    *,
    study: PhaseStudy,
    chosen: Sequence[Cell] | None = None,
    progress: Callable[[str, float, float], None] | None = None,
) -> dict[str, Any]:
    """Write the page of all nested models, its tables and its pictures.

    Args:
        folder: where; it exists.
        models: by key, as `NestedModels.models` when all are fitted.
        study: the iiwa's phases.
        chosen: the cells the models predict; None for all of the Panda.
        progress: called with (stage, done, total).

    Returns:
        The summary that ``--json`` prints: scores of every model, targets, causes by joint.

    Raises:
        StictionError: a model is missing, or predicts another number of cells.
    """
    chosen = cells() if chosen is None else list(chosen)
    missing = [key for key in ModelScores.ALL if key not in models]
    if missing:
        raise StictionError(f"the page needs all nested models: {', '.join(missing)} not fitted")
    for key, model in models.items():
        if len(model.change) != len(chosen):
            raise StictionError(
                f"model {key!r} predicts {len(model.change)} cells, but there are {len(chosen)}"
            )
    scores = ModelScores(models, chosen)
    tasks: list[tuple[str, Callable[[Path], None]]] = [
        ("ladder.png", lambda path: figures.models(scores, path)),
        ("residuals.png", lambda path: figures.residuals(scores, path)),
    ]
    for number in JOINTS:

        def draw(path: Path, number: int = number) -> None:
            figures.joint(scores, number, path)

        tasks.append((f"joint_{number}.png", draw))
    tasks.append(("iiwa.png", lambda path: figures.iiwa(study, path)))
    for done, (name, task) in enumerate(tasks):
        task(folder / name)
        if progress is not None:
            progress("page", done + 1, len(tasks))
    values = numbers(scores, study)
    for name in ("ladder.md", "gap.md"):
        templates.write_page(folder / name, TEMPLATES / f"{name}.j2", **values)
    return summary(scores)


def summary(scores: ModelScores) -> dict[str, Any]:
    """Return scores, targets and causes as plain values, errors in % of the base torque."""
    return {
        "held_out_cells": int(scores.held_out.sum()),
        "repeats": {"mean": scores.floor[0], "median": scores.floor[1]},
        "models": [
            {
                "key": key,
                "name": s.name,
                "mean": s.mean,
                "ci95": [s.low, s.high],
                "median": s.median,
                "by_table": s.by_column,
                "by_joint": s.by_joint,
            }
            for key, s in scores.scores.items()
        ],
        "targets": {
            name: {"reached": reached, "target": aim, "met": reached <= aim}
            for name, (reached, aim) in scores.targets().items()
        },
        "causes": [
            {
                "joint": number,
                "name": g.key,
                "before": g.plain.before,
                "after": g.plain.after,
                "ci95": [g.plain.low, g.plain.high],
            }
            for number in JOINTS
            for g in scores.gains(number)
            if g.named
        ],
    }
