"""Pictures of `real_logs`: all joints, and each robot's residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from _real_logs_page import Row, joints
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from stiction_envs.reporting.png import save_small

RIGID, USUAL, TOOL = "#c2590c", "0.45", "#1f5fa8"


def draw(rows: dict[str, Row], folder: Path) -> list[str]:
    """All pictures; their names."""
    names = ["real_logs.png"]
    _overview(rows, folder / names[0])
    for robot in ("panda", "iiwa14", "tx40"):
        names.append(f"real_logs_{robot}.png")
        mine = [(j, row) for r, j, row in joints(rows) if r == robot]
        _residuals(robot, mine, folder / names[-1])
    return names


def _overview(rows: dict[str, Row], path: Path) -> None:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots()
    all_of = joints(rows)
    for k, (_, j, row) in enumerate(all_of):
        rms = {name: v[j - 1] for name, v in row["rms"].items()}
        usual = min(rms["coulomb_viscous"], rms.get("coulomb_viscous_offset", np.inf))
        axes.vlines(k, rms["extended"], rms["rigid"], color="0.8", lw=2, zorder=1)
        for y, colour, mark, text in (
            (rms["rigid"], RIGID, "o", "rigid"),
            (usual, USUAL, "s", "Coulomb, viscous, offset"),
            (rms["extended"], TOOL, "o", "tool"),
            (row["noise"][j - 1], "0.1", "_", "noise floor"),
        ):
            size = 14 if mark == "_" else 7
            axes.plot(k, y, mark, color=colour, ms=size, label=text if k == 0 else None)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(range(len(all_of)), [f"{r}\n{j}" for r, j, _ in all_of], fontsize=8)
    axes.set_ylabel("held-out residual [N·m]")
    axes.legend(fontsize=8.5, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    axes.grid(alpha=0.25, lw=0.6, axis="y")
    axes.spines[["top", "right"]].set_visible(False)
    save_small(figure, path)


def _residuals(robot: str, shown: list[tuple[int, Row]], path: Path) -> None:
    figure = Figure(figsize=(13, 1.9 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 3, squeeze=False, width_ratios=(2.2, 1, 1))
    for number, (line, (j, row)) in enumerate(zip(grid, shown, strict=True), 1):
        s = row["samples"][j - 1]
        limit = 1.15 * np.percentile(np.abs(s["before"]), 99.5) + 1e-9
        for axes, x, label in zip(
            line, ("t", "dq", "q"), ("time [s]", "speed [rad/s]", "angle [rad]"), strict=True
        ):
            for key, colour in (("before", RIGID), ("after", TOOL)):
                axes.plot(s[x], s[key], ".", ms=2, mew=0, color=colour)
            axes.set_ylim(-limit, limit)
            _tidy(axes)
            if number == len(shown):
                axes.set_xlabel(label, fontsize=9)
        line[0].set_ylabel(f"joint {j}\nresidual [N·m]", fontsize=9)
    figure.suptitle(
        f"{robot}: measured less modelled torque; orange rigid, blue the tool's model",
        fontsize=10.5,
        x=0.01,
        ha="left",
    )
    save_small(figure, path)


def _tidy(axes: Axes) -> None:
    axes.axhline(0, color="0.6", lw=0.7, zorder=0)
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
