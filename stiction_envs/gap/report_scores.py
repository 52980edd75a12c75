"""Pictures of how good the models are: held-out residual, and forward proof."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.forward_validation import Proof
from stiction_envs.gap.report_figures import AFTER, BEFORE, Drawn
from stiction_envs.reporting.png import save_small

Array = NDArray[np.float64]


def draw_summary(d: Diagnosis, path: Path) -> Drawn:
    """Draw the held-out residual of each joint: nominal, extended, noise floor."""
    n = d.data.n
    figure = Figure(figsize=(1.6 + 0.95 * n, 3.4), layout="constrained")
    axes = figure.subplots()
    draw_pairs(axes, d.nominal_rms, d.extended_rms)
    axes.plot(np.arange(n), d.noise, "_", color="0.1", ms=26, mew=1.6, label="noise floor")
    axes.set_ylabel("held-out residual [N·m]")
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    save_small(figure, path)
    return Drawn(path.name, "Root mean square residual on data that was not fitted.")


def draw_pairs(axes: Axes, nominal: Array, extended: Array) -> None:
    """Draw an arrow from nominal to extended for each joint."""
    x = np.arange(len(nominal))
    axes.vlines(x, nominal, extended, color="0.6", lw=2, zorder=1)
    axes.plot(x, nominal, "o", color=BEFORE, ms=8, label="nominal")
    axes.plot(x, extended, "o", color=AFTER, ms=8, label="extended")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(x, [f"joint {j + 1}" for j in x])
    axes.set_xlim(-0.6, len(nominal) - 0.4)
    axes.margins(y=0.12)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, lw=0.6, axis="y")
    axes.spines[["top", "right"]].set_visible(False)


def draw_proof(proof: Proof, path: Path) -> Drawn:
    """Draw the forward proof: errors of each joint, and windows of the joint that gains most."""
    figure = Figure(figsize=(11.5, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 4)
    for half, (name, unit, a, b) in enumerate(
        (
            (
                "replay: angle error",
                "rad",
                proof.nominal.position_rms,
                proof.extended.position_rms,
            ),
            ("tracking: torque added", "N·m", proof.nominal.torque_rms, proof.extended.torque_rms),
        )
    ):
        axes = figure.add_subplot(grid[0, 2 * half : 2 * half + 2])
        draw_pairs(axes, a, b)
        axes.set_ylabel(f"root mean square [{unit}]", fontsize=9)
        axes.set_title(name, fontsize=10, loc="left")
        if half == 0:
            axes.legend(fontsize=8, frameon=False)
    best = int(np.argmax(proof.position_gain))
    shown = proof.time <= proof.settings.replay
    for k, w in enumerate(np.linspace(0, len(proof.start) - 1, 4).astype(int)):
        axes = figure.add_subplot(grid[1, k])
        base = proof.measured[w, 0, best]
        for run, colour in ((proof.nominal, BEFORE), (proof.extended, AFTER)):
            axes.plot(proof.time[shown], run.angle[w, :, best] - base, color=colour, lw=1.4)
        truth = proof.measured[w, shown, best] - base
        axes.plot(proof.time[shown], truth, color="0.1", lw=1.4, ls="--")
        axes.set_title(f"joint {best + 1} from {proof.start[w]:.2f} s", fontsize=9, loc="left")
        axes.set_xlabel("time in the window [s]", fontsize=9)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        if k == 0:
            axes.set_ylabel("angle from its start [rad]\n(dashed: measured)", fontsize=9)
    save_small(figure, path)
    return Drawn(
        path.name,
        "The logs' torques drive both models in stock MuJoCo, from the measured state, in windows "
        "that were not fitted.",
    )
