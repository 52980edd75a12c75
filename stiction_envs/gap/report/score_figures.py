"""Pictures of how good the models are: held-out error, simulation, logs that took no part."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from stiction_envs.gap.report.figures import AFTER, BEFORE, clock, tidy, trace
from stiction_envs.gap.report.result import Picture
from stiction_envs.gap.validation.check import Check
from stiction_envs.gap.validation.forward import REPLAY, ForwardValidation
from stiction_envs.reporting.png import save_small

Array = NDArray[np.float64]
JOINTS = 3
"""Joints whose residual is drawn over time [-]: those that are worse, else those that gain most.
Assumed."""


def draw_summary(
    nominal: Array,
    extended: Array,
    noise: Array,
    path: Path,
    label: str,
    caption: str,
    joints: Sequence[int] = (),
) -> Picture:
    """Draw the held-out error of each joint into a PNG: nominal, extended, noise floor, (n,) each.

    ``label`` is the axis's, with the unit; ``joints`` are their numbers, () counts them from 1.
    """
    figure = Figure(figsize=(max(3.2, 1.6 + 0.95 * len(noise)), 3.4), layout="constrained")
    axes = figure.subplots()
    _pairs(axes, nominal, extended, noise, joints)
    axes.set_ylabel(label)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    save_small(figure, path)
    return Picture(path.name, caption)


def _pairs(
    axes: Axes,
    nominal: Array,
    extended: Array,
    noise: Array | None = None,
    joints: Sequence[int] = (),
) -> None:
    """Draw a line from nominal to extended for each joint."""
    x = np.arange(len(nominal))
    axes.vlines(x, nominal, extended, color="0.6", lw=2, zorder=1)
    axes.plot(x, nominal, "o", color=BEFORE, ms=8, label="nominal")
    axes.plot(x, extended, "o", color=AFTER, ms=8, label="extended")
    if noise is not None:
        axes.plot(x, noise, "_", color="0.1", ms=26, mew=1.6, label="noise floor")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(x, [f"joint {j}" for j in joints or x + 1])
    axes.set_xlim(-0.6, len(nominal) - 0.4)
    axes.margins(y=0.12)
    tidy(axes, zero=False)


def draw_forward(forward: ForwardValidation, path: Path) -> Picture:
    """Draw both models in simulation: errors, and windows of the joint that gains most."""
    figure = Figure(figsize=(11.5, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 4)
    n, e = forward.nominal, forward.extended
    replay = "replay: angle error", "rad", n.position_rms, e.position_rms
    tracking = "tracking: torque added", "N·m", n.torque_rms, e.torque_rms
    for half, (name, unit, before, after) in enumerate((replay, tracking)):
        axes = figure.add_subplot(grid[0, 2 * half : 2 * half + 2])
        _pairs(axes, before, after)
        axes.set_ylabel(f"root mean square [{unit}]", fontsize=9)
        axes.set_title(name, fontsize=10, loc="left")
        if half == 0:
            axes.legend(fontsize=8, frameon=False)
    best = int(np.argmax(forward.position_gain))
    shown = forward.time <= REPLAY
    for k, w in enumerate(np.linspace(0, len(forward.start) - 1, 4).astype(int)):
        axes = figure.add_subplot(grid[1, k])
        start = forward.measured[w, 0, best]
        for run, colour in ((n, BEFORE), (e, AFTER)):
            axes.plot(forward.time[shown], run.angle[w, :, best] - start, color=colour, lw=1.4)
        truth = forward.measured[w, shown, best] - start
        axes.plot(forward.time[shown], truth, color="0.1", lw=1.4, ls="--")
        axes.set_title(f"joint {best + 1} from {forward.start[w]:.2f} s", fontsize=9, loc="left")
        axes.set_xlabel("time in the window [s]", fontsize=9)
        tidy(axes, zero=False)
        if k == 0:
            axes.set_ylabel("angle from its start [rad]\n(dashed: measured)", fontsize=9)
    save_small(figure, path)
    return Picture(
        path.name,
        "The logs' torques drive both models in stock MuJoCo, from the measured state, in windows "
        "that were not fitted.",
    )


def draw_check(check: Check, path: Path) -> Picture:
    """Draw both models on the check logs: errors of each joint, residuals over time below."""
    n = len(check.noise)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(check.extended_rms / check.nominal_rms, nan=1.0)
    order = np.argsort(-ratio if check.worse_joints else ratio, kind="stable")
    many = min(JOINTS, n, len(check.worse_joints) or n)
    shown = sorted(int(j) for j in order[:many])
    figure = Figure(figsize=(10.5, 3.0 + 1.7 * len(shown)), layout="constrained")
    grid = figure.add_gridspec(1 + len(shown), 1, height_ratios=[1.6, *[1.0] * len(shown)])
    top = figure.add_subplot(grid[0])
    _pairs(top, check.nominal_rms, check.extended_rms, check.noise)
    top.set_ylabel("error on the check logs\n[N·m]", fontsize=9)
    for label in (x for j, x in enumerate(top.get_xticklabels()) if j + 1 in check.worse_joints):
        label.set_color("#b00020")
        label.set_fontweight("bold")
    data, time = check.data, clock(check.data)
    for k, j in enumerate(shown):
        axes = figure.add_subplot(grid[1 + k])
        for torque, colour in ((data.nominal, BEFORE), (check.extended, AFTER)):
            trace(axes, time, data.tau[:, j] - torque[:, j], data, colour, "", 0.9)
        tidy(axes)
        axes.set_title(f"joint {j + 1}", fontsize=9, loc="left")
        axes.set_ylabel("residual\n[N·m]", fontsize=9)
    axes.set_xlabel("time, segments one after another [s]", fontsize=9)
    lines = {"nominal model": BEFORE, "extended model": AFTER, "noise floor": "0.1"}
    handles = [Line2D([], [], color=c, lw=2) for c in lines.values()]
    figure.legend(
        *(handles, list(lines)), loc="outside upper right", ncols=3, fontsize=9, frameon=False
    )
    figure.suptitle(f"logs that took no part: the model {check.verdict}", x=0.02, ha="left")
    save_small(figure, path)
    worse = "the joints that are worse" if check.worse_joints else "the joints that gain most"
    return Picture(
        path.name,
        "Root mean square error of both models on logs that took no part, and their residuals over "
        f"time on {worse}.",
    )
