"""Table 4.11 and Figures 4.6 to 4.8, E.1, F.1 and F.2: paths under impedance control.

What the study ``gte`` finds is a pair for each path and stiffness: without dither, and with the
final one of Table 4.9. All of it is the shipped set-up; the thesis prints no path sizes, start or
speeds.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.experiments.gte import plots
from stiction_envs.experiments.gte.measures import error_against_time
from stiction_envs.experiments.gte.protocol import AXES, TRAJECTORIES
from stiction_envs.experiments.gte.rows import thesis_stiffness
from stiction_envs.measured import thesis_table
from stiction_envs.reporting.markdown import percent, signed
from stiction_envs.thesis.ensemble_page import write_ensemble
from stiction_envs.thesis.gte import Pair, WindowSum, score, window_sums
from stiction_envs.thesis.items import (
    Found,
    Item,
    Needs,
    Said,
    Write,
    Written,
    say,
    write_figure,
    write_table,
)

LETTERS = "abcdef"
ENSEMBLE = "all"
"""The only part of the study ``ensemble``."""


def path_needs(*trajectories: str) -> Callable[[], Needs]:
    """Return what an item of these paths needs; none for all."""
    chosen = trajectories or TRAJECTORIES
    return lambda: {"gte": [(t, k) for t in chosen for k in thesis_stiffness()]}


def pairs_of(found: Found, trajectories: Sequence[str] = TRAJECTORIES) -> list[Pair]:
    """Return the pairs of some paths, in the thesis's order."""
    return [found["gte"][t, k] for t in trajectories for k in thesis_stiffness()]


# ---- Table 4.11 ----------------------------------------------------------------------------------


def sums_needs() -> Needs:
    """Return what Table 4.11 needs: the shipped set-up, and others that the thesis allows."""
    return {**path_needs()(), "ensemble": [ENSEMBLE]}


def write_window_sums(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.11, of the shipped set-up, and how it lies among those the thesis allows."""
    pairs = pairs_of(found)
    rows, iterations = window_sums(pairs), len(pairs[0][0][0].accepted)
    lines, shown = [], []
    for printed, r in zip(thesis_table("4.11"), rows, strict=True):
        difference = 100 * (r.simulated_change - r.measured_change)
        lines.append([*printed.values(), *astuple(r)[-4:], difference])
        shown.append(
            [
                f"{r.trajectory} {r.stiffness}",
                f"{r.axis} [{r.unit}]",
                *(f"{x:.3f}" for x in (r.measured_no_dither, r.measured_dither)),
                percent(100 * r.measured_change),
                *(f"{x:.3f}" for x in (r.simulated_no_dither, r.simulated_dither)),
                percent(100 * r.simulated_change) + ("" if r.clear(iterations) else " (noise)"),
                signed(difference, 1),
            ]
        )
    written = write_table(
        item,
        folder,
        columns=[
            *thesis_table("4.11")[0],
            *(f.name for f in fields(WindowSum)[-4:]),
            "difference_points",
        ],
        rows=lines,
        header=[
            *("case", "axis", "measured: no dither", "dither", "change"),
            *("simulated: no dither", "dither", "change", "difference [points]"),
        ],
        shown=shown,
        said=say_sums(rows, iterations),
    )
    members, lag = found["ensemble"][ENSEMBLE]
    section, _ = write_ensemble(folder, members, lag)
    # under the heading of the item, which is of the third order
    below = re.sub(r"^(#+) ", r"##\1 ", section, flags=re.MULTILINE)
    return dataclasses.replace(
        written,
        body=f"{written.body}\n\n{below}",
        files=(*written.files, "ensemble.csv", "ensemble.png"),
    )


def say_sums(rows: Sequence[WindowSum], iterations: int) -> Said:
    """Return what Table 4.11 says of the shipped set-up."""
    found = score(rows)
    return say(
        "sums",
        **found,
        median=100 * float(np.median([r.simulated_change for r in rows])),
        measured=100 * float(np.median([r.measured_change for r in rows])),
        unclear=sum(not r.clear(iterations) for r in rows) if iterations > 1 else None,
    )


# ---- paths ---------------------------------------------------------------------------------------


def write_plane(item: Item, found: Found, folder: Path) -> Written:
    """Draw Figure 4.6: all paths from above."""
    pairs = pairs_of(found)
    figure = Figure(figsize=(12, 10.4), layout="constrained")
    for k, (axes, pair) in enumerate(zip(figure.subplots(2, 2).ravel(), pairs, strict=True)):
        runs = [run for run, _ in pair]
        plots.draw_path_xy(axes, runs, legend=False, mean=True)
        axes.set_title(f"({LETTERS[k]}) {plots.case_text(runs[0].case)}", loc="left", fontsize=11)
    _path_legend(figure, pairs)
    return write_figure(item, folder, figure, say_paths(pairs))


def write_space(item: Item, found: Found, folder: Path) -> Written:
    """Draw Figure E.1: all paths in space."""
    pairs = pairs_of(found)
    figure = Figure(figsize=(12, 10.4))
    for k, pair in enumerate(pairs):
        runs = [run for run, _ in pair]
        left, up = 0.485 * (k % 2), 0.5 * (1 - k // 2)
        axes = figure.add_axes((left + 0.005, up + 0.005, 0.455, 0.49), projection="3d")
        plots.draw_path_3d(axes, runs, mean=True)
        title = f"({LETTERS[k]}) {plots.case_text(runs[0].case)}"
        figure.text(left + 0.04, up + 0.46, title, fontsize=11)
    figure.legend(
        handles=plots.path_legend([run for run, _ in pairs[0]]),
        loc="lower center",
        ncols=4,
        frameon=False,
    )
    return write_figure(item, folder, figure, say_paths(pairs))


def _path_legend(figure: Figure, pairs: Sequence[Pair]) -> None:
    figure.legend(
        handles=plots.path_legend([run for run, _ in pairs[0]]),
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )


def say_paths(pairs: Sequence[Pair]) -> Said:
    """Return whether dithered paths follow their reference better, and what stiffness does."""

    def distance(k: int) -> list[float]:
        return [float(np.sqrt((pair[k][1].rms[:, :3] ** 2).sum(axis=1)).mean()) for pair in pairs]

    def left(k: int) -> list[float]:
        return [float(pair[k][1].left[:, -1, 0].mean()) for pair in pairs]

    before, after = distance(0), distance(1)
    return say(
        "paths",
        cases=len(pairs),
        change=[100 * (b / a - 1) for a, b in zip(before, after, strict=True)],
        better=sum(b < a for a, b in zip(before, after, strict=True)),
        end=[100 * (b / a - 1) for a, b in zip(left(0), left(1), strict=True)],
        stiffer=[b / a for a, b in zip(before[::2], before[1::2], strict=True)],
    )


# ---- errors against time -------------------------------------------------------------------------


def error_writer(trajectory: str, *, orientation: bool = False) -> Write:
    """Return what draws Figures 4.7, 4.8, F.1 or F.2: an axis a row, a stiffness a column."""
    rows = range(3, 6) if orientation else range(3)

    def write(item: Item, found: Found, folder: Path) -> Written:
        pairs = pairs_of(found, [trajectory])
        figure = Figure(figsize=(13.5, 9.2), layout="constrained")
        grid = figure.subplots(3, len(pairs), sharex="col")
        for column, pair in enumerate(pairs):
            runs = [run for run, _ in pair]
            stiffness = "/".join(f"{k:g}" for k in runs[0].case.stiffness)
            for line, k in enumerate(rows):
                axes = grid[line, column]
                plots.draw_error(axes, runs, k)
                letter = LETTERS[len(pairs) * line + column]
                axes.set_title(f"({letter}) {AXES[k]}, {stiffness}", loc="left", fontsize=10)
            grid[-1, column].set_xlabel("time [s]")
        handles, names = plots.error_legend_entries(grid[0, 0], [run for run, _ in pairs[0]])
        figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
        return write_figure(item, folder, figure, say_errors(pairs, rows))

    return write


def say_errors(pairs: Sequence[Pair], rows: Sequence[int]) -> Said:
    """Return what dither and stiffness do to mean errors and to their spread.

    Args:
        pairs: of one path, the lower stiffness first.
        rows: columns of the error.
    """
    change, spread = [], []
    for pair in pairs:
        before, after = (m.mean[:, list(rows)].mean(axis=0) for _, m in pair)
        change.append(100 * (after / before - 1))
        both = [error_against_time(run)[1][:, list(rows)] for run, _ in pair]
        spread.append([float(np.median(s)) for s in both])
    names = [AXES[k] for k in rows]
    return say(
        "errors",
        axes=names,
        iterations=len(pairs[0][0][0].accepted),
        fallen=[int((c < 0).sum()) for c in change],
        median=[float(np.median(c)) for c in change],
        spread_dither=[s[1] / s[0] if s[0] else float("nan") for s in spread],
        spread_stiffer=spread[-1][1] / spread[0][1] if spread[0][1] else float("nan"),
    )
