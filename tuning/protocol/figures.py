"""Plots of the tuner's report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.experiments.sje.protocol import Configuration, Measurement, configurations
from stiction_envs.measured import DitheredRow
from stiction_envs.reporting.png import save_full
from tuning.protocol.stages import ThesisTuner, change

Final = Mapping[Configuration, Measurement]
SIMULATED, MEASURED = "#1f5fa8", "#d1701a"
SCALE_STYLE = [":", "-", "--", "-."]


def frequency(tuner: ThesisTuner, rows: Sequence[DitheredRow], path: Path) -> None:
    """Draw the mean change of each joint against frequency, a line per scale."""
    n = tuner.experiment.n
    columns = 4
    lines = -(-(n + 1) // columns)
    figure = Figure(figsize=(12, 3.1 * lines), layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False)
    frequencies = sorted(tuner.frequencies)
    for joint, axes in zip(range(1, n + 1), grid.ravel(), strict=False):
        cs = configurations(n, [joint])
        for scale, style in zip(tuner.scales, SCALE_STYLE, strict=False):
            mean = [
                np.mean([change(tuner.cells[tuner.job(c, f, scale)], tuner.base[c]) for c in cs])
                for f in frequencies
            ]
            label = f"simulated, scale {scale:g}"
            axes.plot(frequencies, mean, style, color=SIMULATED, lw=1.5, label=label)
        for scale, marker in ((0.8, "v"), (1.0, "o"), (1.2, "^")):
            mine = [r for r in rows if r.joint == joint and r.table != "4.10" and not r.outlier]
            at = sorted({r.frequency_hz for r in mine if r.scale == scale})
            y = [
                np.mean([r.change_pct for r in mine if (r.frequency_hz, r.scale) == (f, scale)])
                for f in at
            ]
            if at:
                axes.plot(at, y, marker, color=MEASURED, ms=6, label=f"measured, scale {scale:g}")
        axes.axhline(0, color="0.3", lw=0.8)
        axes.set_xscale("log")
        axes.set_xticks(frequencies, [f"{f:g}" for f in frequencies])
        axes.minorticks_off()
        axes.set_title(f"joint {joint}")
        axes.set_xlabel("dither frequency [Hz]")
        axes.set_ylabel("change of torque [%]")
        axes.grid(alpha=0.3)
    handles, labels = grid.ravel()[0].get_legend_handles_labels()
    for axes in grid.ravel()[n:]:
        axes.axis("off")
    grid.ravel()[n].legend(handles, labels, loc="center", frameon=False)
    figure.suptitle("Change of the torque that moves a joint, mean of four configurations")
    save_full(figure, path)


def verification(tuner: ThesisTuner, final: Final, rows: Sequence[DitheredRow], path: Path) -> None:
    """Draw the change with the final table for every configuration, with what was measured."""
    cs = configurations(tuner.experiment.n)
    x = np.arange(len(cs))
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots()
    ours = [change(final[c], tuner.base[c]) for c in cs]
    axes.bar(x + 0.2, ours, 0.4, color=SIMULATED, label="simulated, our final table")
    measured = {
        (r.joint, r.load, r.direction): r.change_pct
        for r in rows
        if r.table == "4.10" and r.amplitude_set == "final"
    }
    if measured:
        theirs = [measured[c.joint, c.load, c.direction] for c in cs]
        axes.bar(x - 0.2, theirs, 0.4, color=MEASURED, label="measured, the thesis's final table")
    axes.axhline(0, color="0.3", lw=0.8)
    names = [f"{c.joint} {'L' if c.load == 'load' else 'N'}{c.direction}" for c in cs]
    axes.set_xticks(x, names, rotation=90, fontsize=8)
    axes.legend(frameon=False)
    axes.grid(axis="y", alpha=0.3)
    axes.set(
        xlabel="joint, pose (L load, N no load), direction",
        ylabel="change of torque [%]",
        title="Torque to move each joint with the final dither, against none",
    )
    save_full(figure, path)
