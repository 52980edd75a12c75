"""Picture of an excitation: angles in their ranges, speeds, and the condition number reached."""

from __future__ import annotations

import os

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stiction_envs.experiments.sje.plots import WITH, WITHOUT
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import Arm

Array = NDArray[np.float64]


def plot_excitation(
    t: Array,
    q: Array,
    dq: Array,
    path: str | os.PathLike[str],
    *,
    arm: Arm,
    condition: float,
    random: Array,
) -> None:
    """Draw a motion.

    Args:
        t: (T,) times from its start to its end [s].
        q: (T, n) angles [rad].
        dq: (T, n) speeds [rad/s].
        path: PNG to write.
        arm: the arm it was found for.
        condition: its condition number [-].
        random: (R,) those of random motions inside the same limits [-].
    """
    low, high = arm.limits.position.T
    figure = Figure(figsize=(9.6, 7.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(3.4, 1))
    angle, speed = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    bars = figure.add_subplot(grid[:, 1])
    for j in range(arm.n):
        colour = colormaps["viridis"](j / max(1, arm.n - 1) * 0.92)
        where = (q[:, j] - low[j]) / (high[j] - low[j])
        angle.plot(t, where, color=colour, lw=1.3, label=f"{j + 1}")
        speed.plot(t, dq[:, j] / arm.limits.velocity[j], color=colour, lw=1.3)
    for y in (0, 1):
        angle.axhline(y, color="black", lw=0.8, ls="--")
    for y in (-1, 1):
        speed.axhline(y, color="black", lw=0.8, ls="--")
    angle.set(ylabel="angle in its range [-]", ylim=(-0.05, 1.05), xlim=(0, t[-1]))
    angle.tick_params(labelbottom=False)
    speed.set(ylabel="speed over its limit [-]", xlabel="time [s]", xlim=(0, t[-1]))
    speed.set_ylim(-1.1, 1.1)
    angle.legend(title="joint", loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    _conditions(bars, condition, random)
    title = arm.title
    figure.suptitle(f"{title}: excitation, {t[-1]:.3g} s, κ = {condition:.3g}")
    save_full(figure, path)


def _conditions(axes: Axes, condition: float, random: Array) -> None:
    rng = np.random.default_rng(0)
    spread = rng.uniform(-0.15, 0.15, len(random))
    axes.scatter(spread, random, color=WITHOUT, s=18)
    axes.scatter([1], [condition], color=WITH, s=60, marker="D")
    axes.set(yscale="log", xlim=(-0.5, 1.5), ylabel="condition number κ of the scaled regressor")
    axes.set_xticks([0, 1], ["random,\nsame limits", "optimised"])
    axes.grid(axis="y", which="both", alpha=0.25)
