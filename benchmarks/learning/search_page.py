"""Page and picture of `search`: tables of its rows; the words are in ``search.md.j2``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.harness import Row
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.png import save_full
from tuning.settings import tuning_settings

Measured = dict[str, dict[str, dict[str, Row]]]
"""Per condition, path and treatment: errors left over nothing [-] and vibration [m]."""
PICTURED = 3
"""Conditions that are drawn: known friction, and two that are believed wrong."""
PARTS = ("position", "orientation")
LONGER = "common gate, 1600 evaluations", "the same from another seed"
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
    panda = paths["panda"]
    names = list(panda)
    pushes = [[w, *(f"{1e3 * x:.3f}" for x in shaken)] for w, shaken in hunting.items()]
    iiwas = [robot for robot in paths if robot != "panda"]
    return {
        "settings": tuning_settings(),
        "wins": _wins(panda[names[0]]),
        "both": lambda *a, robot="panda", **k: _both(paths[robot], *a, **k),
        "shaken": lambda name, condition=names[0]: _shaken(panda[condition], name),
        "conditions": names,
        "tables": {name[0].upper() + name[1:]: _tracking(panda[name]) for name in names},
        "joints": _joints(joints["panda"]),
        "pushes": table_text(["width", *(f"× {gain:g}" for gain in gains)], pushes),
        "nothing_at_rest": next(iter(panda[names[0]].values()))["nothing"]["vibration_at_rest_m"],
        "better": {name: _better(panda, name) for name in LONGER},
        "less": lambda *a: _less(panda, *a),
        "changes": _changes(panda),
        "gate_points": _gate_points(panda),
        "iiwas": {
            r: {"joints": _joints(joints[r]), "paths": _tracking(paths[r][names[0]])} for r in iiwas
        },
        "reduced": {r: {name: _reduction(x) for name, x in joints[r].items()} for r in iiwas},
    }


def _ratio(results: dict[str, dict[str, Row]], name: str, part: str) -> float:
    """Return an error left [%], geometric mean over paths."""
    return 100 * float(np.exp(np.mean([np.log(rows[name][part]) for rows in results.values()])))


def _shaken(results: dict[str, dict[str, Row]], name: str) -> float:
    """Return the vibration at rest [mm], mean over paths."""
    return 1e3 * float(np.mean([rows[name]["vibration_at_rest_m"] for rows in results.values()]))


def _both(
    measured: Measured, name: str, condition: str = "", path: str = "", rest: bool = False
) -> str:
    """Return position and orientation error left [%]; of one path or of all."""
    results = measured[condition or next(iter(measured))]
    some = {path: results[path]} if path else results
    parts = (f"resting_{part}" if rest else part for part in PARTS)
    return " / ".join(number(_ratio(some, name, part), 0) for part in parts)


def _wins(results: dict[str, dict[str, Row]]) -> bool:
    """Whether a searched push leaves less of both errors than any dither."""
    names = next(iter(results.values()))
    dithers = [name for name in names if "push" not in name and "feedforward" not in name]
    return all(
        _ratio(results, "push, searched", part) < min(_ratio(results, d, part) for d in dithers)
        for part in PARTS
    )


def _gate_points(panda: Measured) -> float:
    """Return by how much the longest search's table needs its gate: largest change [points]."""
    one, other = LONGER[0], "the same without its gate"
    return 100 * max(
        abs(rows[one][f"{rest}{part}"] - rows[other][f"{rest}{part}"])
        for results in panda.values()
        for rows in results.values()
        for rest in ("", "resting_")
        for part in PARTS
    )


def _at_rest(panda: Measured, name: str, condition: str, path: str) -> list[float]:
    """Return position and orientation error left at rest [-]."""
    return [panda[condition][path][name][f"resting_{part}"] for part in PARTS]


def _less(panda: Measured, name: str, condition: str, path: str) -> str:
    """Return by how much less than Table 4.9 a treatment leaves at rest [%]."""
    ours, thesis = (_at_rest(panda, x, condition, path) for x in (name, "Table 4.9"))
    return " / ".join(number(100 * (1 - a / b), 0) for a, b in zip(ours, thesis, strict=True))


def _better(panda: Measured, name: str) -> list[int]:
    """Count how often a longer search leaves less at rest than the constant table, and more.

    By more than a point; of two paths, two parts, the arm's rest and other start poses.
    """
    known, *_, elsewhere = panda
    names = "search, constant", name
    points = [
        100 * (a - b)
        for condition in (known, elsewhere)
        for path in panda[condition]
        for a, b in zip(*(_at_rest(panda, x, condition, path) for x in names), strict=True)
    ]
    return [sum(x > 1 for x in points), sum(x < -1 for x in points), len(points)]


def _changes(panda: Measured) -> dict[str, float]:
    """Return by how much errors left at rest differ [points], means over the same as `_better`.

    ``longer``: how much less a longer search leaves than the constant table; ``seed``: how far the
    same from another seed is from it, either way; ``start``: other start poses likewise.
    """
    known, *_, elsewhere = panda

    def left(name: str, condition: str) -> NDArray[np.float64]:
        return 100 * np.array([_at_rest(panda, name, condition, p) for p in panda[condition]])

    def difference(one: str, other: str) -> NDArray[np.float64]:
        return np.array([left(one, c) - left(other, c) for c in (known, elsewhere)])

    longer, other = LONGER
    return {
        "longer": float(difference("search, constant", longer).mean()),
        "seed": float(np.abs(difference(other, longer)).mean()),
        "start": float(np.abs(left(longer, elsewhere) - left(longer, known)).mean()),
    }


def _reduction(rows: list[Row]) -> float:
    """Return by how much less torque moves a joint [%], mean of all joints."""
    return 100 * float(np.mean([1 - row["left"] for row in rows]))


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
        cells = [
            f"{number(100 * (1 - row['left']))} %, {1e3 * row['displacement_rad']:.3f} mrad"
            for row in rows
        ]
        lines.append([name, *cells, f"{number(_reduction(rows))} %"])
    numbers = range(1, 1 + len(lines[0][1:-1]))
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
