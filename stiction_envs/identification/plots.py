"""Pictures of an excitation, and of an identification."""

import os
from collections.abc import Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from stiction_envs.arrays import Array
from stiction_envs.experiments.sje.plots import WITH, WITHOUT
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import Arm, arm_title

COLOURS = ("0.8", "0.55", "#5b8db8", "#d1701a")
"""Colours of `identification.MODELS`."""


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
    """Draw angles in their ranges, speeds, and the condition number reached; write a PNG.

    t is (T,) [s], q and dq are (T, n) [rad, rad/s]; ``random`` (R,) are the condition numbers of
    random motions inside the same limits [-].
    """
    low, high = arm.limits.position.T
    figure = Figure(figsize=(9.6, 7.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(3.4, 1))
    angle, speed = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    points = figure.add_subplot(grid[:, 1])
    for j in range(arm.n):
        colour = colormaps["viridis"](j / max(1, arm.n - 1) * 0.92)
        where = (q[:, j] - low[j]) / (high[j] - low[j])
        angle.plot(t, where, color=colour, lw=1.3, label=f"{j + 1}")
        speed.plot(t, dq[:, j] / arm.limits.velocity[j], color=colour, lw=1.3)
    for axes, bounds in ((angle, (0, 1)), (speed, (-1, 1))):
        for y in bounds:
            axes.axhline(y, color="black", lw=0.8, ls="--")
    angle.set(ylabel="angle in its range [-]", ylim=(-0.05, 1.05), xlim=(0, t[-1]))
    angle.tick_params(labelbottom=False)
    speed.set(ylabel="speed over its limit [-]", xlabel="time [s]", xlim=(0, t[-1]))
    speed.set_ylim(-1.1, 1.1)
    angle.legend(title="joint", loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    spread = np.random.default_rng(0).uniform(-0.15, 0.15, len(random))
    points.scatter(spread, random, color=WITHOUT, s=18)
    points.scatter([1], [condition], color=WITH, s=60, marker="D")
    points.set(yscale="log", xlim=(-0.5, 1.5), ylabel="condition number κ of the scaled regressor")
    points.set_xticks([0, 1], ["random,\nsame limits", "optimised"])
    points.grid(axis="y", which="both", alpha=0.25)
    figure.suptitle(f"{arm_title(arm.name)}: excitation, {t[-1]:.3g} s, κ = {condition:.3g}")
    save_full(figure, path)


def plot_identification(
    name: str, rms: Mapping[str, Array], noise: Array, path: str | os.PathLike[str]
) -> None:
    """Draw the held-out residual (n,) of every joint under every model, and the noise [N·m]."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots()
    joints = np.arange(1, len(noise) + 1)
    width = 0.8 / len(rms)
    for k, (model, left) in enumerate(rms.items()):
        axes.bar(joints + (k - 1.5) * width, left, width, color=COLOURS[k], label=model)
    axes.hlines(noise, joints - 0.45, joints + 0.45, colors="black", label="noise")
    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    for which in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        which("{x:g}")
    axes.set_xticks(joints)
    axes.set(xlabel="joint", ylabel="held-out torque residual, RMS [N·m]")
    axes.set_title(f"{name}: what each model leaves (lower is better)")
    axes.grid(axis="y", which="both", alpha=0.25)
    axes.set_axisbelow(True)
    axes.legend(ncols=5, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    save_full(figure, path)
