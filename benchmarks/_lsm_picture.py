"""The picture of `lsm_failure`: friction torque over speed, as the thesis's Figure 4.1."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.gap.least_squares import line
from stiction_envs.reporting.png import save_small

Panel = tuple[str, np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray] | None]
"""Title, speeds [rad/s], friction torques [N·m] and the truth over speed, where it is known."""


def panel(axes: Axes, panel: Panel) -> None:
    """Draw samples and the lines of equation 3.1."""
    title, v, tau, truth = panel
    axes.plot(v, tau, ".", ms=2, color="0.6", mew=0)
    for sign in (1, -1):
        rows = sign * v > 0
        m, b, r2 = line(v[rows], tau[rows])
        x = np.array([0, sign * np.percentile(sign * v[rows], 99.5)])
        axes.plot(x, m * x + b, color="#c2590c", lw=2, label=f"R² {r2:.2g}")
    if truth is not None:
        x = np.linspace(*np.percentile(v, [0.3, 99.7]), 800)
        axes.plot(x, truth(x), color="0.1", lw=1.2, ls=(0, (4, 2)), label="truth")
    limit = 1.25 * np.percentile(np.abs(tau), 99)
    axes.set_ylim(-limit, limit)
    axes.set_title(title, fontsize=8, loc="left")
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=7.5, frameon=False, loc="upper left")


def draw_panels(panels: list[Panel], path: Path) -> None:
    """Draw all panels, five in a row."""
    rows = -(-len(panels) // 5)
    figure = Figure(figsize=(15, 3.3 * rows), layout="constrained")
    grid = figure.subplots(rows, 5, squeeze=False).ravel()
    for axes, one in zip(grid, panels, strict=False):
        panel(axes, one)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[::5]:
        axes.set_ylabel("friction torque [N·m]", fontsize=9)
    for axes in grid[-5:]:
        axes.set_xlabel("speed [rad/s]", fontsize=9)
    save_small(figure, path)
