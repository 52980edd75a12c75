"""Plots of the tuner's report."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.experiments.sje.protocol import Configuration, Measurement, configurations
from stiction_envs.measured.thesis_tables import DitheredRow
from stiction_envs.reporting.png import save_full
from tuning.protocol.stages import ThesisTuner, change

Final = Mapping[Configuration, Measurement]
SIMULATED, MEASURED = "#1f5fa8", "#d1701a"
SCALE_STYLE = [":", "-", "--", "-."]


def joint_plots(n: int, size: tuple[float, float] = (3.4, 3.0)) -> tuple[Figure, list[Axes]]:
    """Return a figure with ``n`` plots of a size [inch] and an empty one for `one_legend`."""
    columns = min(4, n + 1)
    rows = -(-(n + 1) // columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    axes = list(np.ravel(figure.subplots(rows, columns, squeeze=False)))
    for spare in axes[n:]:
        spare.axis("off")
    return figure, axes


def one_legend(axes: Sequence[Axes], used: int) -> None:
    """Put one legend of the used plots into the empty plot behind them."""
    entries: dict[str, Artist] = {}
    for axis in axes[:used]:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    axes[used].legend(entries.values(), entries.keys(), loc="center", frameon=False, fontsize=9)


def frequency(tuner: ThesisTuner, rows: Sequence[DitheredRow], path: Path) -> None:
    """Draw the mean change of each joint against frequency, a line per scale."""
    n = tuner.experiment.n
    figure, plots = joint_plots(n, (3.0, 3.1))
    frequencies = sorted(tuner.frequencies)
    for joint, axes in enumerate(plots[:n], 1):
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
    one_legend(plots, n)
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
