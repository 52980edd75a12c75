"""Plots of a search: landscape, front."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from stiction_envs.reporting.png import save_full
from tuning.protocol.figures import joint_plots, one_legend
from tuning.search.bounds import Bounds, Table
from tuning.search.trials import allowed, complete, front
from tuning.study.record import Record

MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
COLOURS = ("#c0285f", "#d1701a", "#2b7bba", "#4a9a4a", "#8c6bb1", "#8a5a2b", "#1a7a6a", "#555555")
LEAST = 8  # Fewest trials for a landscape (assumed)


def landscape(
    bounds: Bounds, records: Sequence[Record], tables: Mapping[str, Table], path: Path
) -> None:
    """Draw each joint's reduction over frequency and amplitude, and the setting of every table."""
    tried = [t for r in records for t in complete(r.trials) if "left" in t.user_attrs]
    figure, axes = joint_plots(bounds.n)
    for j, axis in enumerate(axes[: bounds.n], 1):
        mine = [t for t in tried if t.user_attrs["joint"] == j]
        names = ("frequency_hz", "amplitude_nm", "left")
        f, a, left = (np.array([t.user_attrs[name] for t in mine]) for name in names)
        reduction = 100.0 * (1.0 - left)
        good = np.array([allowed(t) for t in mine], dtype=bool)
        if len(mine) >= LEAST and np.ptp(f) > 0 and np.ptp(a) > 0:
            axis.tricontourf(f, a, reduction, levels=np.arange(-10, 101, 5), cmap="viridis")
        for mask, marker, label in ((good, "o", "allowed"), (~good, "x", "shakes too much")):
            image = axis.scatter(
                f[mask],
                a[mask],
                c=reduction[mask],
                marker=marker,
                vmin=-10,
                vmax=100,
                cmap="viridis",
                edgecolors="white" if marker == "o" else None,
                linewidths=0.7,
                s=22,
                label=f"tried, {label}",
            )
        for k, (name, table) in enumerate(tables.items()):
            for row in table:
                if row.joint == j and row.amplitude_nm:
                    axis.plot(
                        row.frequency_hz,
                        row.amplitude_nm,
                        MARKS[k % len(MARKS)],
                        color=COLOURS[k % len(COLOURS)],
                        markeredgecolor="white",
                        markersize=9,
                        label=name,
                    )
        low, high = bounds.frequency_hz[j - 1]
        even = np.geomspace(low, high, 100)
        most = [bounds.largest(j, float(x)) for x in even]
        axis.plot(even, most, color="0.3", lw=1, ls="--", label="torque and rate limits")
        axis.set_xscale("log")
        ticks = [x for x in (15, 20, 30, 50, 80) if low <= x <= high]
        axis.set_xticks(ticks, [f"{x}" for x in ticks])
        axis.minorticks_off()
        axis.set_xlim(0.95 * low, 1.05 * high)
        axis.set_ylim(-0.03 * max(most), 1.08 * max(most))
        axis.set(title=f"joint {j}", xlabel="frequency [Hz]", ylabel="amplitude [N·m]")
    figure.colorbar(image, ax=axes, label="reduction of the breakaway torque [%]", shrink=0.6)
    one_legend(axes, bounds.n)
    save_full(figure, path)


def pareto(records: Mapping[str, Sequence[Record]], path: Path) -> None:
    """Draw both objectives of all trials, and the Pareto front."""
    group = [(stage, k, r) for stage, found in records.items() for k, r in enumerate(found, 1)]
    figure, axes = joint_plots(len(group))
    for axis, (stage, k, record) in zip(axes, group, strict=False):
        sje = stage == "sje"
        for trials, colour, label in (
            (complete(record.trials), "0.7", "tried"),
            (front(record.trials), COLOURS[0], "none is better"),
        ):
            left = [100 * (t.values[0] if sje else np.exp(t.values[0])) for t in trials]
            x = [1e3 * t.values[1] for t in trials]
            axis.plot(x, left, "o", color=colour, ms=4, label=label)
        axis.set(
            title=f"joint {k}" if sje else "GTE",
            xlabel="displacement, rms [mrad]" if sje else "vibration, rms [mm]",
            ylabel="torque left [%]" if sje else "error left [%]",
        )
        axis.grid(alpha=0.3)
    one_legend(axes, len(group))
    save_full(figure, path)
