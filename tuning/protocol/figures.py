"""Plots of the tuner's report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.experiments.sje.protocol import Configuration, Measurement, configurations
from stiction_envs.measured import BaseTable, DitheredRow
from stiction_envs.reporting.png import save_full
from tuning.protocol.stages import ThesisTuner, change

Final = Mapping[Configuration, Measurement]
Look = dict[str, Any]
SIMULATED, MEASURED = "#1f5fa8", "#d1701a"
SCALE_STYLE = [":", "-", "--", "-."]


def _bars(
    cs: Sequence[Configuration],
    ylabel: str,
    title: str,
    bars: Sequence[tuple[float, Sequence[float], Look]],
    path: Path,
) -> None:
    """Draw bars of the configurations: at an offset, their heights and how they look."""
    x = np.arange(len(cs))
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots()
    for offset, heights, options in bars:
        axes.bar(x + offset, heights, 0.4, **options)
    axes.axhline(0, color="0.3", lw=0.8)
    names = [f"{c.joint} {'L' if c.load == 'load' else 'N'}{c.direction}" for c in cs]
    axes.set_xticks(x, names, rotation=90, fontsize=8)
    axes.legend(frameon=False)
    axes.grid(axis="y", alpha=0.3)
    axes.set(xlabel="joint, pose (L load, N no load), direction", ylabel=ylabel, title=title)
    save_full(figure, path)


def base(tuner: ThesisTuner, measured: BaseTable, path: Path) -> None:
    """Draw simulated and measured base torques of every configuration."""
    cs = configurations(tuner.experiment.n)
    values = [measured.get(c.joint, c.load, c.direction) for c in cs]
    means, stds = [tuner.base[c].mean for c in cs], [tuner.base[c].std for c in cs]
    simulated = {"yerr": stds, "capsize": 2, "color": SIMULATED, "label": "simulated, ± std"}
    _bars(
        cs,
        "base torque τ_b [N·m]",
        f"Torque to move each joint by {tuner.experiment.protocol.threshold:g} rad without dither",
        [(-0.2, values, {"color": MEASURED, "label": "measured"}), (0.2, means, simulated)],
        path,
    )


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
    ours = {"color": SIMULATED, "label": "simulated, our final table"}
    bars = [(0.2, [change(final[c], tuner.base[c]) for c in cs], ours)]
    measured = {
        (r.joint, r.load, r.direction): r.change_pct
        for r in rows
        if r.table == "4.10" and r.amplitude_set == "final"
    }
    if measured:
        theirs = {"color": MEASURED, "label": "measured, the thesis's final table"}
        bars.append((-0.2, [measured[c.joint, c.load, c.direction] for c in cs], theirs))
    title = "Torque to move each joint with the final dither, against none"
    _bars(cs, "change of torque [%]", title, bars, path)
