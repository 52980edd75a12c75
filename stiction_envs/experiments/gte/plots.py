"""Plots of the Generated Trajectory Experiment, as the thesis's Figures 4.6 to 4.8, E.1, F.1, F.2.

Grey is without dither, orange with it, other colours are with compensation, black dashed is the
reference, purple dotted where goals were accepted. With them Table 4.11, simulated and measured.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from stiction_envs.arrays import Array
from stiction_envs.control.laws import LAWS
from stiction_envs.experiments.gte.measures import error_against_time, sample_period
from stiction_envs.experiments.gte.protocol import AXES, Case, Run
from stiction_envs.experiments.gte.rows import case_name
from stiction_envs.experiments.sje.plots import WITH, WITHOUT, plain_axes
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import arm_title

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

ACCEPTED = "#7b3fa0"  # Colour of accepted goals, purple as in the thesis
_COMPENSATED = (("#1a7a6a", "#66a61e"), ("#2b7bba", "#c0285f"))
"""Colours of compensated cases, without and with dither, of every second law in turn."""
# accepted goals without dither, with it, the same with compensation
_DOTS = ((0, (1, 1.5)), (0, (1, 4)), (0, (3, 3)), (0, (3, 6)))


def colour(run: Run) -> str:
    """Return the colour of a run."""
    case = run.case
    if case.compensation is None:
        return WITH if case.dithered else WITHOUT
    return _COMPENSATED[list(LAWS).index(case.compensation.kind) % 2][case.dithered]


def label(run: Run) -> str:
    """Return the name of a run in a legend."""
    return case_name(run.case).replace("_", " ")


def case_text(case: Case) -> str:
    """Return a case's path and stiffness as the thesis writes them."""
    return f"{case.trajectory}, stiffness {'/'.join(f'{k:g}' for k in case.stiffness)}"


def _title(run: Run, robot: str, what: str) -> str:
    rounds = len(run.accepted)
    count = f"{rounds} iterations" if rounds > 1 else "one iteration"
    return f"{arm_title(robot)}, {case_text(run.case)}: {what} ({count})"


def published(run: Run) -> tuple[Array, Array]:
    """Return the reference of the first iteration and its goals, (K, 3), (G, 3) [m].

    NaN rows separate the movements: between them the reference goes to the measured pose at once.
    A goal is where the reference rests when it is reached.
    """
    reference, period = run.reference[0, :, :3], sample_period(run)
    goals = reference[np.maximum(np.rint(run.reached[0] / period).astype(int) - 1, 0)]
    cuts = np.rint(run.accepted[0, 1:] / period).astype(int)
    return np.insert(reference, cuts, np.nan, axis=0), goals


def plot_path_xy(runs: Sequence[Run], path: str | os.PathLike[str], *, robot: str) -> None:
    """Draw the paths of one case in the plane of the base's x and y (Figure 4.6) as a PNG.

    `case_name` tells ``runs``, of one path and stiffness, apart.
    """
    figure = Figure(figsize=(7.6, 6.2), layout="constrained")
    draw_path_xy(figure.subplots(), runs)
    figure.suptitle(_title(runs[0], robot, "path"), fontsize=11)
    save_full(figure, path)


def draw_path_xy(
    axes: Axes, runs: Sequence[Run], *, legend: bool = True, mean: bool = False
) -> None:
    """Draw the paths of one case in the plane of the base's x and y on given axes.

    Draw each iteration's, or their ``mean`` as in the thesis.
    """
    goals = _paths(axes, runs, (0, 1), mean=mean)
    for k, goal in enumerate(goals):
        axes.annotate(
            f"{k + 1}",
            goal[:2],
            xytext=(6, 6),
            textcoords="offset points",
            color=ACCEPTED,
            fontsize=10,
        )
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    plain_axes(axes)
    if legend:
        axes.legend(handles=path_legend(runs), loc="best", frameon=False, fontsize=9)


def plot_path_3d(runs: Sequence[Run], path: str | os.PathLike[str], *, robot: str) -> None:
    """Draw the paths of one case in space (Figure E.1); arguments as `plot_path_xy`."""
    figure = Figure(figsize=(7.6, 6.4))
    draw_path_3d(figure.add_axes((-0.03, 0.0, 1.0, 0.94), projection="3d"), runs)
    figure.legend(
        handles=path_legend(runs), loc="upper left", bbox_to_anchor=(0.02, 0.94), frameon=False
    )
    figure.suptitle(_title(runs[0], robot, "path"), fontsize=11)
    save_full(figure, path)


def draw_path_3d(axes: Axes3D, runs: Sequence[Run], *, mean: bool = False) -> None:
    """Draw the paths of one case in space on given axes of three dimensions."""
    _paths(axes, runs, (0, 1, 2), mean=mean)
    drawn = [r.actual[:, :, :3].reshape(-1, 3) for r in runs] + [published(runs[0])[1]]
    points = np.concatenate(drawn)
    low, high = points.min(axis=0), points.max(axis=0)
    # equal scales, so that lengths can be compared; a flat path keeps a third of the height
    half = max(0.55 * float(np.max(high - low)), 0.01)
    share = np.array([1.0, 1.0, max(1 / 3, 0.55 * float((high - low)[2]) / half)])
    for k, name in enumerate("xyz"):
        middle, size = (low[k] + high[k]) / 2, share[k] * half
        getattr(axes, f"set_{name}lim")(middle - size, middle + size)
        getattr(axes, f"set_{name}label")(f"{name} [m]", labelpad=9)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(5 if k < 2 else 3))
    axes.set_box_aspect(tuple(share), zoom=1.0)
    axes.view_init(elev=32, azim=-60)


def _paths(axes: Axes, runs: Sequence[Run], dims: tuple[int, ...], *, mean: bool = False) -> Array:
    """Draw paths and reference; return the goals (G, 3) [m]."""
    for run in runs:
        actual = run.actual.mean(axis=0, keepdims=True) if mean else run.actual
        rounds = len(actual)
        for k in range(rounds):
            axes.plot(
                *(actual[k, :, d] for d in dims),
                color=colour(run),
                lw=1.6 if mean else 1.1,
                alpha=1.0 if rounds == 1 else 0.45,
            )
    # the reference of the run without dither, if there: the other's starts elsewhere at corners
    reference, goals = published(runs[0])
    axes.plot(*(reference[:, d] for d in dims), color="0.05", lw=1.2, ls=(0, (4, 3)), zorder=4)
    axes.plot(*(goals[:, d] for d in dims), "o", color=ACCEPTED, ms=5, zorder=5)
    return goals


def path_legend(runs: Sequence[Run]) -> list[Line2D]:
    """Return the legend of a picture of paths."""
    entries = [Line2D([], [], color=colour(run), lw=1.8, label=label(run)) for run in runs]
    text = "reference" if len(runs) == 1 else f"reference ({label(runs[0])}, iteration 1)"
    entries.append(Line2D([], [], color="0.05", lw=1.2, ls=(0, (4, 3)), label=text))
    entries.append(Line2D([], [], color=ACCEPTED, marker="o", ls="", ms=5, label="goals"))
    return entries


def plot_errors(
    runs: Sequence[Run], path: str | os.PathLike[str], *, robot: str, orientation: bool = False
) -> None:
    """Draw mean error and standard deviation against time (Figures 4.7, 4.8; F.1, F.2) as a PNG.

    `case_name` tells ``runs``, of one path and stiffness, apart; axes are x, y, z, or roll, pitch
    and yaw with ``orientation``.
    """
    columns = range(3, 6) if orientation else range(3)
    figure = Figure(figsize=(8.6, 7.4), layout="constrained")
    panels: Sequence[Axes] = figure.subplots(3, 1, sharex=True)
    for axes, k in zip(panels, columns, strict=True):
        draw_error(axes, runs, k)
    panels[-1].set_xlabel("time [s]")
    panels[0].legend(
        *error_legend_entries(panels[0], runs),
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=4,
        frameon=False,
        fontsize=8.5,
        columnspacing=1.4,
    )
    what = "orientation error, mean and std" if orientation else "position error, mean and std"
    figure.suptitle(_title(runs[0], robot, what), fontsize=11)
    save_full(figure, path)


def draw_error(axes: Axes, runs: Sequence[Run], k: int) -> None:
    """Draw mean error and standard deviation of axis ``k`` of :data:`AXES` against time."""
    axes.axhline(0, color="0.7", lw=0.8, zorder=1)
    for run in runs:
        mean, spread = (1e3 * v[:, k] for v in error_against_time(run))
        axes.fill_between(
            run.time, mean - spread, mean + spread, color=colour(run), alpha=0.25, lw=0
        )
        axes.plot(run.time, mean, color=colour(run), lw=1.5, label=label(run), zorder=3)
    for run, style in zip(runs, _DOTS, strict=False):
        for goal, t in enumerate(run.accepted.mean(axis=0)):
            if goal > 0 or run is runs[0]:
                axes.axvline(t, color=ACCEPTED, lw=1.2, ls=style, zorder=2)
    axes.set_ylabel(f"{AXES[k]} error [{'mm' if k < 3 else 'mrad'}]")
    plain_axes(axes)
    axes.margins(x=0.01, y=0.08)


def error_legend_entries(axes: Axes, runs: Sequence[Run]) -> tuple[list[Artist], list[str]]:
    """Return handles and names of what `draw_error` has drawn."""
    handles, names = axes.get_legend_handles_labels()
    for run, style in zip(runs, _DOTS, strict=False):
        names.append("goal accepted" + (f", {label(run)}" if len(runs) > 1 else ""))
        handles.append(Line2D([], [], color=ACCEPTED, lw=1.2, ls=style))
    return handles, names
