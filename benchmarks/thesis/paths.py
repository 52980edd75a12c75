"""Table 4.11 and Figures 4.6 to 4.8, E.1, F.1 and F.2: paths under impedance control.

What the study ``gte`` finds is a pair for each path and stiffness: without dither, and with the
final one of Table 4.9. All of it is the shipped set-up; the thesis prints no path sizes, start or
speeds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.thesis.items import Found, Needs, Picture, Table
from stiction_envs.experiments.gte import plots
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import AXES, TRAJECTORIES, Run
from stiction_envs.experiments.gte.rows import UNITS, thesis_stiffness
from stiction_envs.measured.thesis_tables import thesis_table
from stiction_envs.reporting.markdown import listed, number, percent, signed

Array = NDArray[np.float64]
Pair = tuple[tuple[Run, Measures], tuple[Run, Measures]]
"""The run without dither and the one with it."""
LETTERS = "abcdef"
KINDS = ("no_dither", "dither")
"""Ends of the names of the printed columns."""


def path_needs(*trajectories: str) -> Needs:
    """Return what an item of these paths needs; none for all."""
    return {"gte": [(t, k) for t in trajectories or TRAJECTORIES for k in thesis_stiffness()]}


def pairs_of(found: Found, trajectories: Sequence[str] = TRAJECTORIES) -> list[Pair]:
    """Return the pairs of some paths, in the thesis's order."""
    return [found["gte"][t, k] for t in trajectories for k in thesis_stiffness()]


# ---- Table 4.11 ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class WindowSums:
    """Sums of |error| over 200 samples, (2, 24): without dither and with it, cases by axes.

    Units are [m·samples] and [rad·samples].
    """

    measured: Array
    simulated: Array
    """Means over iterations."""
    std: Array
    """Over iterations; NaN for one."""
    iterations: int

    @property
    def changes(self) -> tuple[Array, Array]:
        """Relative change by dither [-], simulated and measured."""
        return self.simulated[1] / self.simulated[0] - 1, self.measured[1] / self.measured[0] - 1

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Whether the simulated change is above twice its standard error."""
        error = np.hypot(*self.std) / math.sqrt(self.iterations)
        return np.abs(np.diff(self.simulated, axis=0)[0]) > 2.0 * error


def window_sums(pairs: Sequence[Pair]) -> WindowSums:
    """Return the sums of Table 4.11, in its order."""
    printed = [[row[f"mean_error_{x}"] for row in thesis_table("4.11")] for x in KINDS]
    sums = np.array([[pair[k][1].window_sum for pair in pairs] for k in range(2)])
    n = sums.shape[2]
    std = sums.std(axis=2, ddof=1) if n > 1 else np.full_like(sums[:, :, 0], np.nan)
    return WindowSums(
        measured=np.array(printed),
        simulated=sums.mean(axis=2).reshape(2, -1),
        std=std.reshape(2, -1),
        iterations=n,
    )


def compare_sums(s: WindowSums) -> str:
    """Return how many signs of dither's effect come out, and how far off sizes are."""
    now, old = s.changes
    right, rises = np.sign(now) == np.sign(old), old > 0
    off = np.exp(np.sqrt((np.log(s.simulated[0] / s.measured[0]) ** 2).mean()))
    return (
        f'{right.sum()} of {len(old)} signs ("every error falls": {(old < 0).sum()}; rises: '
        f"{right[rises].sum()} of {rises.sum()}), sizes off by a factor of {number(float(off))}"
    )


def table_4_11(found: Found) -> Table:
    """Return Table 4.11, of the shipped set-up."""
    s = window_sums(pairs_of(found))
    now, old = s.changes
    difference = 100 * (now - old)
    lines, shown = [], []
    for k, row in enumerate(thesis_table("4.11")):
        simulated: dict[str, float] = {}
        for kind, mean, std in zip(KINDS, s.simulated[:, k], s.std[:, k], strict=True):
            simulated |= {f"simulated_{kind}": mean, f"simulated_{kind}_std": std}
        lines.append({**row, **simulated, "difference_points": difference[k]})
        stiffness = [row[f"stiffness_{x}"] for x in ("translation", "rotation", "nullspace")]
        shown.append(
            [
                f"{row['trajectory']} {'/'.join(f'{x:g}' for x in stiffness)}",
                f"{row['axis']} [{UNITS[row['axis']]}·samples]",
                *(f"{x:.3f}" for x in s.measured[:, k]),
                percent(100 * old[k]),
                *(f"{x:.3f}" for x in s.simulated[:, k]),
                percent(100 * now[k]) + ("" if s.clear[k] else " (noise)"),
                signed(difference[k], 1),
            ]
        )
    header = ["case", "axis", "measured", "with dither", "change"]
    header += ["simulated", "with dither", "change", "difference [points]"]
    return Table(rows=lines, header=header, shown=shown, compared=compare_sums(s))


# ---- paths ---------------------------------------------------------------------------------------


def _runs(pair: Pair) -> list[Run]:
    return [run for run, _ in pair]


def figure_4_6(found: Found) -> Picture:
    """Return Figure 4.6: all paths from above."""
    pairs = pairs_of(found)
    figure = Figure(figsize=(12, 10.4), layout="constrained")
    for letter, axes, pair in zip(LETTERS, figure.subplots(2, 2).ravel(), pairs, strict=False):
        plots.draw_path_xy(axes, _runs(pair), legend=False, mean=True)
        axes.set_title(f"({letter}) {plots.case_text(pair[0][0].case)}", loc="left", fontsize=11)
    _path_legend(figure, pairs, "outside lower center")
    return Picture(figure, compare_paths(pairs))


def figure_e_1(found: Found) -> Picture:
    """Return Figure E.1: all paths in space."""
    pairs = pairs_of(found)
    figure = Figure(figsize=(12, 10.4))
    for k, pair in enumerate(pairs):
        left, up = 0.485 * (k % 2), 0.5 * (1 - k // 2)
        axes = figure.add_axes((left + 0.005, up + 0.005, 0.455, 0.49), projection="3d")
        plots.draw_path_3d(axes, _runs(pair), mean=True)
        title = f"({LETTERS[k]}) {plots.case_text(pair[0][0].case)}"
        figure.text(left + 0.04, up + 0.46, title, fontsize=11)
    _path_legend(figure, pairs, "lower center")
    return Picture(figure, compare_paths(pairs))


def _path_legend(figure: Figure, pairs: Sequence[Pair], place: Any) -> None:
    handles = plots.path_legend(_runs(pairs[0]))
    figure.legend(handles=handles, loc=place, ncols=4, frameon=False)


def compare_paths(pairs: Sequence[Pair]) -> str:
    """Return what dither does to the distance from the reference."""
    distance = np.array(
        [[np.sqrt((m.rms[:, :3] ** 2).sum(axis=1)).mean() for _, m in pair] for pair in pairs]
    )
    change = 100 * (distance[:, 1] / distance[:, 0] - 1)
    return f"closer in {(change < 0).sum()} of {len(pairs)} cases, by {number(-change.mean())} %"


# ---- errors against time -------------------------------------------------------------------------


def error_figure(trajectory: str, orientation: bool, found: Found) -> Picture:
    """Return Figure 4.7, 4.8, F.1 or F.2: an axis a row, a stiffness a column."""
    rows = range(3, 6) if orientation else range(3)
    pairs = pairs_of(found, [trajectory])
    figure = Figure(figsize=(13.5, 9.2), layout="constrained")
    grid = figure.subplots(3, len(pairs), sharex="col")
    for column, pair in enumerate(pairs):
        stiffness = "/".join(f"{k:g}" for k in pair[0][0].case.stiffness)
        for line, k in enumerate(rows):
            axes = grid[line, column]
            plots.draw_error(axes, _runs(pair), k)
            letter = LETTERS[len(pairs) * line + column]
            axes.set_title(f"({letter}) {AXES[k]}, {stiffness}", loc="left", fontsize=10)
        grid[-1, column].set_xlabel("time [s]")
    handles, names = plots.error_legend_entries(grid[0, 0], _runs(pairs[0]))
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
    return Picture(figure, compare_errors(pairs, rows))


def compare_errors(pairs: Sequence[Pair], rows: Sequence[int]) -> str:
    """Return what dither does to mean errors.

    Args:
        pairs: of one path, the lower stiffness first.
        rows: columns of the error.
    """
    columns = list(rows)
    mean = np.array([[m.mean[:, columns].mean(axis=0) for _, m in pair] for pair in pairs])
    falls = (mean[:, 1] < mean[:, 0]).sum(axis=1)
    return f"errors fall on {listed(falls)} of {len(columns)} axes"
