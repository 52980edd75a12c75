"""Plots of the tuner's report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import (
    LOADS,
    Configuration,
    Job,
    Measurement,
    configurations,
)
from stiction_envs.measured import BaseTable, DitheredRow
from stiction_envs.reporting.png import save_full
from tuning.protocol.stages import ThesisTuner

Verified = dict[str, dict[Job, Measurement]]
SIMULATED, MEASURED = "#1f5fa8", "#d1701a"
SCALE_STYLE = [":", "-", "--", "-."]


def _label(c: Configuration) -> str:
    return f"{c.joint} {'L' if c.load == 'load' else 'N'}{c.direction}"


def _label_bars(axes: Axes, cs: list[Configuration]) -> None:
    """Name the configurations under bars at 0, 1, 2, ..."""
    axes.axhline(0, color="0.3", lw=0.8)
    axes.set_xticks(np.arange(len(cs)), [_label(c) for c in cs], rotation=90, fontsize=8)
    axes.set_xlabel("joint, pose (L load, N no load), direction")
    axes.legend(frameon=False)
    axes.grid(axis="y", alpha=0.3)


def base(tuner: ThesisTuner, measured: BaseTable, path: Path) -> None:
    """Draw simulated and measured base torques of every configuration."""
    cs = configurations(tuner.experiment.n)
    x = np.arange(len(cs))
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots()
    values = [measured.get(c.joint, c.load, c.direction) for c in cs]
    axes.bar(x - 0.2, values, 0.4, color=MEASURED, label="measured")
    means, stds = [tuner.base[c].mean for c in cs], [tuner.base[c].std for c in cs]
    axes.bar(x + 0.2, means, 0.4, yerr=stds, capsize=2, color=SIMULATED, label="simulated, ± std")
    _label_bars(axes, cs)
    axes.set_ylabel("base torque τ_b [N·m]")
    threshold = tuner.experiment.protocol.threshold
    axes.set_title(f"Torque to move each joint by {threshold:g} rad without dither")
    save_full(figure, path)


def frequency(tuner: ThesisTuner, rows: list[DitheredRow], path: Path) -> None:
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
                np.mean([_change(tuner, tuner.job(c, f, scale)) for c in cs]) for f in frequencies
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


def _change(tuner: ThesisTuner, job: Job) -> float:
    m = tuner.cells.get(job)
    if m is None:
        return float("nan")
    return 100.0 * (abs(m.mean) / abs(tuner.base[job.configuration].mean) - 1.0)


def verification(
    tuner: ThesisTuner, verified: Verified, rows: list[DitheredRow], path: Path
) -> None:
    """Draw the change with the final table for every configuration, with what was measured."""
    cs = configurations(tuner.experiment.n)
    x = np.arange(len(cs))
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots()
    final = {j.configuration: m for j, m in verified["final"].items()}
    change = [100 * (abs(final[c].mean) / abs(tuner.base[c].mean) - 1) for c in cs]
    axes.bar(x + 0.2, change, 0.4, color=SIMULATED, label="simulated, our final table")
    measured = {
        (r.joint, r.load, r.direction): r.change_pct
        for r in rows
        if r.table == "4.10" and r.amplitude_set == "final"
    }
    if measured:
        y = [measured[c.joint, c.load, c.direction] for c in cs]
        axes.bar(x - 0.2, y, 0.4, color=MEASURED, label="measured, the thesis's final table")
    _label_bars(axes, cs)
    axes.set_ylabel("change of torque [%]")
    axes.set_title("Torque to move each joint with the final dither, against none")
    save_full(figure, path)


def iterations(tuner: ThesisTuner, verified: Verified) -> list[tuple[int, str, str, str]]:
    """Draw every joint and pose as in the thesis's appendices, without and with the final dither.

    Returns:
        Joint, load and the two files, relative to the tuner's folder.
    """
    threshold = tuner.experiment.protocol.threshold
    rate = tuner.experiment.protocol.ramp_rate
    final = {j.configuration: m for j, m in verified["final"].items()}
    drawn = []
    (tuner.out / "plots").mkdir(exist_ok=True)
    for joint in range(1, tuner.experiment.n + 1):
        for load in LOADS:
            cs = [c for c in configurations(tuner.experiment.n, [joint]) if c.load == load]
            files = {k: f"plots/joint{joint}_{load}_{k}.png" for k in ("base", "final")}
            for name, found in (("base", tuner.base), ("final", final)):
                if (tuner.out / files[name]).exists():  # drawn before an interruption
                    continue
                plots.plot_sje(
                    [found[c] for c in cs if found[c].traces],
                    tuner.out / files[name],
                    robot=tuner.experiment.sticking.arm.name,
                    threshold=threshold,
                    ramp_rate=rate,
                )
            drawn.append((joint, load, files["base"], files["final"]))
    return drawn
