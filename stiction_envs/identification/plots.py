"""The picture of an identification: what each model leaves of the torque of each joint."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from stiction_envs.reporting.png import save_full

Array = NDArray[np.float64]
COLOURS = ("0.8", "0.55", "#5b8db8", "#d1701a")
"""Of `identification.MODELS`."""


def plot_identification(
    name: str, rms: Mapping[str, Array], noise: Array, path: str | Path
) -> None:
    """Draw the held-out residual of every joint under every model, and write a PNG.

    Args:
        name: of the arm.
        rms: (n,) of every model [N·m].
        noise: (n,) [N·m].
        path: of the PNG.
    """
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
    axes.set_xlabel("joint")
    axes.set_ylabel("held-out torque residual, RMS [N·m]")
    axes.set_title(f"{name}: what each model leaves (lower is better)")
    axes.grid(axis="y", which="both", alpha=0.25)
    axes.set_axisbelow(True)
    axes.legend(ncols=5, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    save_full(figure, Path(path))
