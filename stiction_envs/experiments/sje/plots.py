"""Plots of the Single Joint Experiment, as in the thesis's appendices B, C and D.

The commanded torque (dither excluded) runs to the right, counted along the ramp, so that it equals
|τ| where the joint breaks away; the joint's displacement from its pose runs up. Warm colours are
the positive direction, cold ones the negative.
"""

import os
from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from stiction_envs.arrays import Array
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM
from stiction_envs.experiments.sje.protocol import (
    DIRECTIONS,
    POSES,
    SIGNS,
    Job,
    Measurement,
    Protocol,
)
from stiction_envs.experiments.sje.rig import BLOCK
from stiction_envs.measured.tables import SJERow
from stiction_envs.plant import CONTROL_DT
from stiction_envs.reporting.png import save_full
from stiction_envs.robots.registry import arm_title

MAPS = {"+": "YlOrRd", "-": "GnBu"}
WITHOUT, WITH = "0.45", "#d1701a"
MOST_NAMED = 2  # Settings of one joint that a title and a legend have room for


def plain_axes(axes: Axes, *, grid: Literal["both", "x"] = "both") -> None:
    """Give axes a pale grid and no frame above and on the right."""
    axes.grid(alpha=0.25, lw=0.6, axis=grid)
    axes.spines[["top", "right"]].set_visible(False)


def dither_text(job: Job) -> str:
    """Say which dither a job has."""
    if job.amplitude_nm == 0 and job.offset_nm == 0:
        return "no dither"
    shape = "" if job.waveform == DEFAULT_WAVEFORM else f" {job.waveform}"
    offset = f" {job.offset_nm:+.3g} N·m" if job.offset_nm else ""
    return f"{job.frequency_hz:g} Hz{shape}, {job.amplitude_nm:.3g} N·m{offset}"


def ramps(m: Measurement, ramp_rate: float) -> list[tuple[Array, Array]]:
    """Return per iteration the torque along the ramp [N·m] and the displacement [rad], (K,) each.

    Traces may be thinned; ``ramp_rate`` is that of the commanded torque [N·m/s].
    """
    sign = m.job.configuration.sign
    out = []
    for trace, start in zip(m.traces, m.start_torque, strict=True):
        time = (np.arange(len(trace)) + 1) * m.trace_dt - BLOCK * CONTROL_DT
        torque = np.asarray(sign * float(start) + ramp_rate * time, dtype=np.float64)
        out.append((torque, np.array(trace, dtype=np.float64)))
    return out


def plot_sje(
    measurements: Sequence[Measurement],
    path: str | os.PathLike[str],
    *,
    robot: str,
    protocol: Protocol,
) -> None:
    """Draw one joint in one pose, in one or both directions, as a PNG.

    Iterations are above, their mean and standard deviation below.
    """
    figure = Figure(figsize=(8.6, 7.4), layout="constrained")
    draw_sje(figure, measurements, protocol)
    c = measurements[0].job.configuration
    kinds = list(dict.fromkeys(dither_text(m.job) for m in in_direction(measurements)))
    drives = f"{len(kinds)} settings" if len(kinds) > MOST_NAMED else " / ".join(kinds)
    figure.suptitle(f"{arm_title(robot)}, joint {c.joint}, {POSES[c.load]}: {drives}", fontsize=12)
    save_full(figure, path)


def in_direction(measurements: Sequence[Measurement]) -> list[Measurement]:
    """Return measurements with + before −."""
    return sorted(measurements, key=lambda m: DIRECTIONS.index(m.job.configuration.direction))


def draw_sje(
    figure: Figure | SubFigure, measurements: Sequence[Measurement], protocol: Protocol
) -> None:
    """Draw one joint in one pose into a figure or a part of one, as `plot_sje`."""
    threshold, ramp_rate = protocol.threshold, protocol.ramp_rate
    upper, lower = figure.subplots(2, 1, sharex=True, sharey=True)
    for m in in_direction(measurements):
        _iterations(upper, m, ramp_rate)
        _mean(lower, m, ramp_rate)
        end = float(np.mean(m.start)) + m.job.configuration.sign * threshold
        lower.axhline(end, color="0.35", lw=0.9, ls=(0, (4, 3)), zorder=1)
        lower.annotate(
            f"threshold: mean start {SIGNS[m.job.configuration.direction]} {threshold:g} rad",
            (0.01, end),
            xycoords=("axes fraction", "data"),
            xytext=(0, -3 if end > 0 else 3),
            textcoords="offset points",
            va="top" if end > 0 else "bottom",
            fontsize=8,
            color="0.35",
        )
    for axes in (upper, lower):
        plain_axes(axes)
        axes.set_ylabel("joint displacement\nfrom the pose [rad]")
        axes.margins(x=0.02, y=0.07)
    upper.set_title(
        f"iterations (dot: threshold passed, {threshold:g} rad from its own start)",
        loc="left",
        fontsize=10,
    )
    lower.set_title(
        "mean and standard deviation, last values of finished iterations held",
        loc="left",
        fontsize=10,
    )
    lower.set_xlabel("commanded torque along the ramp, |τ| at breakaway [N·m]")
    if len({dither_text(m.job) for m in measurements}) > MOST_NAMED:
        return
    for axes in (upper, lower):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8.5)


def _iterations(axes: Axes, m: Measurement, ramp_rate: float) -> None:
    direction = m.job.configuration.direction
    lines = ramps(m, ramp_rate)
    shades = colormaps[MAPS[direction]](np.linspace(0.92, 0.45, len(lines)))
    for k, ((torque, angle), shade) in enumerate(zip(lines, shades, strict=True)):
        label = f"({SIGNS[direction]}) iteration {k + 1}"
        stuck = not np.isfinite(m.tau[k])
        axes.plot(
            torque,
            angle,
            color=shade,
            lw=1.6 if k == 0 else 1.2,
            ls="--" if k == 0 else "-",
            label=label + (", stuck" if stuck else ", after turning" if k == 0 else ""),
            zorder=3,
        )
        if not stuck:
            axes.plot(torque[-1], angle[-1], "o", color=shade, ms=4, zorder=4)


def _mean(axes: Axes, m: Measurement, ramp_rate: float) -> None:
    direction = m.job.configuration.direction
    colour = colormaps[MAPS[direction]](0.75)
    lines = ramps(m, ramp_rate)
    longest = max(len(line) for line, _ in lines)
    # the last values of iterations that ended before the longest are held (thesis 4.1)
    torque, angles = (
        np.array([np.pad(line[k], (0, longest - len(line[k])), mode="edge") for line in lines])
        for k in range(2)
    )
    torque, angle = torque.mean(axis=0), angles.mean(axis=0)
    spread = angles.std(axis=0, ddof=min(1, len(lines) - 1))
    axes.fill_between(torque, angle - spread, angle + spread, color=colour, alpha=0.22, lw=0)
    axes.plot(
        torque,
        angle,
        color=colour,
        lw=1.8,
        label=f"({SIGNS[direction]}) mean, std of angle",
        zorder=3,
    )
    if np.isfinite(m.mean):
        text = f"({SIGNS[direction]}) |τ| = {abs(m.mean):.3f} N·m"
        text += f"\n     ± {m.std:.3f} N·m" if len(m.tau) > 1 else "\n     (one iteration)"
        axes.errorbar(
            abs(m.mean),
            angle[-1],
            xerr=m.std or None,
            fmt="o",
            color=colour,
            ecolor="0.15",
            capsize=4,
            ms=5,
            lw=1.3,
            zorder=5,
            label=text,
        )


def plot_torques(rows: Sequence[SJERow], path: str | os.PathLike[str], *, robot: str) -> None:
    """Draw every breakaway torque, a configuration in a line: without dither a ring, with it a dot.

    ``rows`` are those of ``sje.csv``, at least one; the title names the robot.
    """
    lines = list(dict.fromkeys((r.joint, r.load, r.direction) for r in rows))
    figure = Figure(figsize=(8.6, 1.3 + 0.26 * len(lines)), layout="constrained")
    axes = figure.subplots()
    for row in rows:
        y = lines.index((row.joint, row.load, row.direction))
        base = not row.amplitude_nm
        axes.errorbar(
            abs(row.tau_nm),
            y,
            xerr=row.std_nm if row.iterations > 1 else None,
            fmt="o",
            color=WITHOUT if base else WITH,
            mfc="white" if base else WITH,
            ms=6,
            capsize=3,
            lw=1.2,
            zorder=3 if base else 4,
            label="no dither" if base else "with dither",
        )
    axes.set_yticks(
        range(len(lines)),
        [f"joint {j}, {POSES[load]} ({SIGNS[d]})" for j, load, d in lines],
        fontsize=8.5,
    )
    for k in range(1, len(lines)):
        if lines[k][0] != lines[k - 1][0]:
            axes.axhline(k - 0.5, color="0.88", lw=0.8, zorder=0)
    axes.invert_yaxis()
    axes.margins(y=0.6 / len(lines))
    axes.set_xlim(left=0)
    plain_axes(axes, grid="x")
    axes.set_xlabel("|τ| at breakaway [N·m]")
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    if len(named) > 1:
        figure.legend(
            named.values(), named.keys(), loc="outside lower center", ncols=2, frameon=False
        )
    figure.suptitle(f"{arm_title(robot)}: torque at which each joint breaks away", fontsize=12)
    save_full(figure, path)
