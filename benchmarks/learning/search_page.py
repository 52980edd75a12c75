"""Page and picture of `search`: tables of its rows; the words are in ``search.md.j2``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Row
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.png import save_full
from tuning.settings import tuning_settings

Measured = dict[str, dict[str, dict[str, Row]]]
"""Per condition, path and treatment: errors left over nothing [-] and vibration [m]."""
PICTURED = 3
"""Conditions that are drawn: known friction, and two that are believed wrong."""
PARTS = ("position", "orientation")
LOOKS = {
    "nothing": ("o", "0.4"),
    "Table 4.9": ("s", "#d1701a"),
    "make tune": ("D", "#b8860b"),
    "search, constant": ("^", "#2b7bba"),
    "search, gated": ("*", "#1f3f8a"),
    "common gate, 1600 evaluations": ("p", "#17a2a2"),
    "the same from another seed": ("d", "#0b5f5f"),
    "feedforward": ("v", "#c0285f"),
    "feedforward, searched": ("<", "#7a1740"),
    "push": ("P", "#4a9a4a"),
    "push, searched": ("X", "#2a5a2a"),
    "push and dither, searched": ("h", "#8c6bb1"),
}
"""Mark and colour of every treatment that is drawn."""


def page(
    *,
    paths: dict[str, Measured],
    joints: dict[str, dict[str, list[Row]]],
    hunting: dict[str, list[float]],
    gains: Sequence[float],
) -> dict[str, Any]:
    """Return what the page's template asks for.

    Args:
        paths: per robot, what every treatment leaves on paths.
        joints: per robot and table, what is left of every joint's breakaway torque.
        hunting: vibration at rest [m] of pushes, per width, by gain.
        gains: of these, over the friction.
    """
    known = next(iter(paths["panda"].values()))
    pushes = [[w, *(f"{1e3 * x:.3f}" for x in shaken)] for w, shaken in hunting.items()]
    return {
        "settings": tuning_settings(),
        "treatments": _treatments(known),
        "push": [number(_ratio(known, "push, searched", part), 0) for part in PARTS],
        "tables": {
            f"{robot}, {name}": _tracking(results)
            for robot, conditions in paths.items()
            for name, results in conditions.items()
        },
        "joints": {robot: _joints(tables) for robot, tables in joints.items()},
        "pushes": table_text(["width", *(f"× {gain:g}" for gain in gains)], pushes),
        "nothing_at_rest": next(iter(known.values()))["nothing"]["vibration_at_rest_m"],
    }


def _ratio(results: dict[str, dict[str, Row]], name: str, part: str) -> float:
    """Return an error left [%], geometric mean over paths."""
    return 100 * float(np.exp(np.mean([np.log(rows[name][part]) for rows in results.values()])))


def _shaken(results: dict[str, dict[str, Row]], name: str) -> float:
    """Return the vibration at rest [mm], mean over paths."""
    return 1e3 * float(np.mean([rows[name]["vibration_at_rest_m"] for rows in results.values()]))


def _treatments(results: dict[str, dict[str, Row]]) -> str:
    """Return a table: what every treatment leaves and how it shakes, over all paths."""

    def both(name: str, when: str) -> str:
        return " / ".join(number(_ratio(results, name, f"{when}{part}"), 0) for part in PARTS)

    names = next(iter(results.values()))
    rows = [
        [name, both(name, ""), both(name, "resting_"), f"{_shaken(results, name):.3f}"]
        for name in names
    ]
    return table_text(["treatment", "over all goals", "at rest", "vibration at rest [mm]"], rows)


def _tracking(results: dict[str, dict[str, Row]]) -> str:
    """Return a table: every path's error left and vibration, per treatment."""
    header, keys = ["treatment"], [*PARTS, *(f"resting_{part}" for part in PARTS)]
    for path in results:
        header += [f"{path}: position", "orientation", "at rest: position", "orientation"]
        header += ["vibration [mm]", "at rest [mm]"]
    lines = []
    for name in next(iter(results.values())):
        line = [name]
        for rows in results.values():
            line += [f"{100 * rows[name][key]:.0f}" for key in keys]
            line += [f"{1e3 * rows[name][f'vibration{x}_m']:.3f}" for x in ("", "_at_rest")]
        lines.append(line)
    return table_text(header, lines)


def _joints(tables: dict[str, list[Row]]) -> str:
    """Return a table: every joint's reduction and displacement, per amplitude table."""
    lines = []
    for name, rows in tables.items():
        less = [100 * (1 - row["left"]) for row in rows]
        cells = [
            f"{number(x)} %, {1e3 * row['displacement_rad']:.3f} mrad"
            for x, row in zip(less, rows, strict=True)
        ]
        lines.append([name, *cells, f"{number(float(np.mean(less)))} %"])
    numbers = range(1, len(lines[0]) - 1)
    return table_text(["table", *(f"joint {j}" for j in numbers), "mean"], lines)


def draw(panda: Measured, path: Path) -> None:
    """Draw error left against vibration at rest."""
    figure = Figure(figsize=(16, 8), layout="constrained")
    axes: Any = figure.subplots(len(PARTS), PICTURED, sharey="row", sharex=True)
    for column, (condition, results) in enumerate(list(panda.items())[:PICTURED]):
        for axis, part in zip(axes[:, column], PARTS, strict=True):
            for name, (mark, colour) in LOOKS.items():
                at = _shaken(results, name), _ratio(results, name, part)
                axis.plot(*at, mark, mec=colour, mfc="none", mew=2, ms=10, label=name)
            axis.grid(alpha=0.3)
            if column == 0:
                axis.set_ylabel(f"{part} error left, of nothing [%]")
        axes[0, column].set_title(condition)
        axes[-1, column].set_xlabel("vibration at rest, rms [mm]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=9, loc="outside right upper")
    save_full(figure, path)
