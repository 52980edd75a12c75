"""Pictures of a diagnosis: each cause against the variable that shows it, each joint's residual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter, MaxNLocator
from numpy.typing import NDArray
from scipy.signal import welch

from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.report.result import Picture
from stiction_envs.gap.selection.candidates import ARM
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.reporting.png import save_small

Array = NDArray[np.float64]
BEFORE, AFTER, CAUSE, MEASURED = "#c2590c", "#1f5fa8", "0.1", "0.35"
Style = str | tuple[int, tuple[int, int]]
LINES: tuple[tuple[str, Style], ...] = ((BEFORE, "-"), (CAUSE, (0, (4, 2))), (AFTER, "-"))
DOTS = 1500
"""Samples drawn per panel [-]; assumed."""
BINS = 36
"""Bins of a panel's mean and quartiles [-]; assumed."""
JOINTS = 3
"""Joints drawn per cause, the clearest first [-]; assumed."""
LONG = 4000
"""Samples drawn of a trace [-]; assumed."""


def _thin(count: int, most: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _binned(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Return centres, means, quartiles of bins of equal width within the 0.5th percentiles."""
    low, high = np.percentile(x, [0.5, 99.5])
    if not high > low:
        return x[:0], x[:0], x[:0], x[:0]
    which = np.clip(((x - low) / (high - low) * BINS).astype(int), 0, BINS - 1)
    inside = (x >= low) & (x <= high)
    out = []
    for k in range(BINS):
        y_k = y[inside & (which == k)]
        if len(y_k) >= max(5, len(y) // (100 * BINS)):
            centre = low + (k + 0.5) * (high - low) / BINS
            out.append((centre, y_k.mean(), *np.percentile(y_k, [25, 75])))
    return tuple(np.array(out).reshape(-1, 4).T)  # type: ignore[return-value]


def _dots(axes: Axes, x: Array, y: Array, colour: str) -> None:
    """Draw samples, the mean and the quartiles of bins; the axis leaves out far-off samples."""
    at = _thin(len(x), DOTS)
    axes.plot(x[at], y[at], ".", ms=2, color=colour, alpha=0.35, mew=0, rasterized=True)
    centre, middle, low, high = _binned(x, y)
    axes.fill_between(centre, low, high, color=colour, alpha=0.25, lw=0)
    axes.plot(centre, middle, color=colour, lw=1.6)
    left, right = np.percentile(x, [0.3, 99.7])
    if right > left:
        room = 0.06 * (right - left)
        axes.set_xlim(left - room, right + room)


def tidy(axes: Axes, *, zero: bool = True) -> None:
    """Give axes a grid, no frame, and a line at zero."""
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    if zero:
        axes.axhline(0, color="0.6", lw=0.7, zorder=0)


def _figure(width: float, height: float, *, top: float, bottom: float) -> Figure:
    """Return a figure whose panels leave room for labels, in inches.

    Layouts that matplotlib works out take as long as all the drawing.
    """
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=0.75 / width,
        right=1 - 0.15 / width,
        top=1 - top / height,
        bottom=bottom / height,
        hspace=0.3,
    )
    return figure


def draw_cause(d: Diagnosis, cause: NamedCause, path: Path) -> Picture:
    """Draw a cause into a PNG: residual without it and its torque above, residual with it below."""
    data, view = d.data, d.library.causes[cause.name].view
    effect = d.cause_torque(cause.name)
    clear = np.sqrt(np.mean(np.square(effect), axis=0)) / data.noise
    of = [j - 1 for j in cause.joints] or list(range(data.n))
    shown = sorted(sorted(of, key=lambda j: -clear[j])[:JOINTS])
    figure = _figure(max(6.8, 1.4 + 3.4 * len(shown)), 5.6, top=0.6, bottom=0.85)
    grid = figure.subplots(2, len(shown), squeeze=False, sharex="col", sharey="col")
    for column, j in enumerate(shown):
        term = next(
            t for t in d.terms if t.cause == cause.name and t.joint in (j, ARM) and not t.small
        )
        after = data.residual[:, j] - d.torque(j)
        before, alone = after + effect[:, j], effect[:, j]
        x = alone if view.of is None else view.of(data, j, term.shape).astype(np.float64)
        rows = np.ones(len(x), dtype=bool)
        if view.folded:
            rows = np.abs(data.dq[:, j]) > 1e-3
            direction = np.sign(data.dq[:, j])
            before, after, alone = (y * direction for y in (before, after, alone))
        if view.limit is not None:
            rows &= np.abs(x) < view.limit(term.shape)
        x, before, after, alone = x[rows], before[rows], after[rows], alone[rows]
        upper, lower = grid[0, column], grid[1, column]
        _dots(upper, x, before, BEFORE)
        centre, middle, *_ = _binned(x, alone)
        upper.plot(centre, middle, color=CAUSE, lw=1.4, ls=(0, (4, 2)))
        _dots(lower, x, after, AFTER)
        upper.set_title(f"joint {j + 1}", fontsize=10, loc="left")
        lower.set_xlabel(view.label, fontsize=9)
        lower.xaxis.set_major_locator(MaxNLocator(6))
        low, high = np.percentile(np.concatenate([before, after]), [0.5, 99.5])
        low, high = min(low, 0.0), max(high, 0.0)
        room = 0.15 * (high - low) + 1e-9
        upper.set_ylim(low - room, high + room)
        tidy(upper)
        tidy(lower)
    folded = " in the direction of motion" if view.folded else ""
    for row, text in enumerate(("without", "with")):
        grid[row, 0].set_ylabel(f"residual{folded},\n{text} the cause [N·m]", fontsize=9)
    handles = [Line2D([], [], color=c, ls=s) for c, s in LINES]
    names = ["residual without it", "what the cause predicts", "residual with it"]
    figure.legend(handles, names, loc="lower center", ncols=3, fontsize=8.5, frameon=False)
    figure.suptitle(f"{cause.name}: {view.note}", fontsize=10.5)
    save_small(figure, path)
    return Picture(
        path.name,
        f"{cause.name}: residual torque{folded} against {view.label}. Above without this cause "
        "(all others taken out), dashed what the cause predicts; below with it. "
        f"Line: mean, band: quartiles. Look for: {view.note}.",
    )


class JointPictures:
    """A joint's torque, and its residual against everything: one figure, drawn for each joint.

    Making its panels and their ticks takes longer than drawing them.
    """

    def __init__(self, d: Diagnosis) -> None:
        """Draw nothing yet."""
        self._d = d
        self._made: tuple[Figure, dict[str, Axes]] | None = None

    def draw(self, joint: int, path: Path) -> Picture:
        """Draw a joint, from 0, into a PNG."""
        if self._made is None:
            self._made = self._figure()
        figure, panels = self._made
        for axes in panels.values():
            for artist in (*axes.lines, *axes.collections, *axes.patches):
                artist.remove()
            axes.relim()
            axes.autoscale()
        self._draw(joint, panels)
        figure.suptitle(f"joint {joint + 1}", x=0.02, ha="left", fontsize=12)
        save_small(figure, path)
        return Picture(path.name, f"Joint {joint + 1}: torque, and residual against everything.")

    def _figure(self) -> tuple[Figure, dict[str, Axes]]:
        """Return a figure and its empty panels by name."""
        still = not np.isfinite(self._d.data.dt)
        figure = _figure(11.5, 8.2, top=0.55, bottom=0.5)
        grid = figure.add_gridspec(3, 3)
        panels = {
            "torque": figure.add_subplot(grid[0, :2]),
            "spectrum": figure.add_subplot(grid[0, 2]),
            "time": figure.add_subplot(grid[1, 0]),
            "angle [rad]": figure.add_subplot(grid[1, 1]),
            "speed [rad/s]": figure.add_subplot(grid[1, 2]),
            "transmitted torque [N·m]": figure.add_subplot(grid[2, 1]),
            "acceleration [rad/s²]": figure.add_subplot(grid[2, 2]),
            "direction": figure.add_subplot(grid[2, 0]),
        }
        top, time = panels["torque"], panels["time"]
        if not still:
            panels["spectrum"].set(xscale="log", yscale="log")
            for axis in (panels["spectrum"].xaxis, panels["spectrum"].yaxis):
                axis.set_major_formatter(LogFormatter())  # the default's exponents take long
                axis.set_minor_formatter(LogFormatter())
        top.set_ylabel("torque [N·m]")
        top.set_xlabel("number of the pose" if still else "time, segments one after another [s]")
        time.set_xlabel("number of the pose" if still else "time [s]")
        for label in list(panels)[3:7]:
            panels[label].set_xlabel(label)
            panels[label].xaxis.set_major_locator(MaxNLocator(6))
        for axes in (time, panels["direction"]):
            axes.set_ylabel("residual [N·m]")
        figure.legend(
            handles=[Line2D([], [], color=BEFORE), Line2D([], [], color=AFTER)],
            labels=["residual of the nominal model", "residual of the extended model"],
            loc="upper right",
            ncols=2,
            fontsize=9,
            frameon=False,
        )
        return figure, panels

    def _draw(self, joint: int, panels: dict[str, Axes]) -> None:
        """Draw a joint into empty panels."""
        data = self._d.data
        before, more = data.residual[:, joint], self._d.torque(joint)
        after = before - more
        top, time, box = panels["torque"], panels["time"], panels["direction"]
        at = clock(data)
        trace(top, at, data.tau[:, joint], data, MEASURED, "measured", 1.6)
        trace(top, at, data.nominal[:, joint], data, BEFORE, "nominal", 0.9)
        trace(top, at, data.nominal[:, joint] + more, data, AFTER, "extended", 0.9)
        top.legend(
            fontsize=8, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98)
        )
        _spectrum(panels["spectrum"], data, before, after, float(data.noise[joint]))
        for y, colour in ((before, BEFORE), (after, AFTER)):
            trace(time, at, y, data, colour, "", 0.8)
        _limits(time, before)
        over = (data.q, data.dq, data.rigid, data.ddq)
        for axes, x in zip(list(panels.values())[3:7], over, strict=True):
            _dots(axes, x[:, joint], before, BEFORE)
            _dots(axes, x[:, joint], after, AFTER)
            _limits(axes, before)
        _directions(box, data.dq[:, joint], before, after)
        _limits(box, before)
        for name, axes in panels.items():
            if name != "spectrum":
                tidy(axes)
            axes.tick_params(labelsize=8)
            axes.xaxis.label.set_fontsize(9)
            axes.yaxis.label.set_fontsize(9)


def clock(data: Data) -> Array:
    """Return (T,) time with the segments put one after another [s]; numbers of poses."""
    if not np.isfinite(data.dt):
        return np.arange(float(len(data.t)))
    step = np.diff(data.t, prepend=data.t[0])
    new = np.diff(data.recording.segment, prepend=data.recording.segment[0]) != 0
    return np.cumsum(np.where(new | (step < 0), 0.0, step))


def trace(
    axes: Axes, x: Array, y: Array, data: Data, colour: str, label: str, width: float
) -> None:
    """Draw a signal (T,) over x (T,), thinned out, with gaps between segments; poses as dots."""
    at = _thin(len(x), LONG)
    if not np.isfinite(data.dt):
        axes.plot(x[at], y[at], ".", ms=3, mew=0, color=colour, label=label)
        return
    y = y[at].copy()
    y[np.flatnonzero(np.diff(data.recording.segment[at]))] = np.nan
    axes.plot(x[at], y, color=colour, lw=width, label=label)


def _limits(axes: Axes, y: Array) -> None:
    limit = 1.3 * float(np.percentile(np.abs(y), 99.5)) + 1e-9
    axes.set_ylim(-limit, limit)


def _spectrum(axes: Axes, data: Data, before: Array, after: Array, noise: float) -> None:
    if not np.isfinite(data.dt):
        _sizes(axes, before, after)
        return
    run = max(data.runs(), key=lambda r: r.stop - r.start)
    length = min(run.stop - run.start, 4096)
    for y, colour in ((before, BEFORE), (after, AFTER)):
        f, power = welch(y[run], fs=1 / data.dt, nperseg=length, detrend="linear")
        axes.plot(f[1:], np.sqrt(power[1:]), color=colour, lw=1)
    axes.axvline(data.cutoff, color="0.4", lw=0.9, ls=":")
    axes.set_xlim(f[1], min(4 * data.cutoff, 0.5 / data.dt))
    shown = (f > 0) & (f < 2 * data.cutoff)
    low = float(np.sqrt(np.maximum(power[shown], 1e-300)).min()) if shown.any() else 1e-6
    axes.set_ylim(bottom=max(low, 1e-3 * noise) / 3)
    axes.set_xlabel("frequency [Hz] (dotted: filter)")
    axes.set_ylabel("residual [N·m/√Hz]")
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _sizes(axes: Axes, before: Array, after: Array) -> None:
    """Draw a histogram of the residuals of poses, which have no spectrum."""
    ends = np.percentile(np.concatenate([before, after]), [0.5, 99.5])
    for y, colour in ((before, BEFORE), (after, AFTER)):
        axes.hist(y, bins=40, range=tuple(ends), color=colour, histtype="step", lw=1.4)
    axes.set_xlabel("residual [N·m]")
    axes.set_ylabel("poses")
    axes.spines[["top", "right"]].set_visible(False)


def _directions(axes: Axes, speed: Array, before: Array, after: Array) -> None:
    groups = [("−", speed < -2e-3), ("rest", np.abs(speed) <= 2e-3), ("+", speed > 2e-3)]
    for k, (_, rows) in enumerate(groups):
        for y, shift, colour in ((before, -0.17, BEFORE), (after, 0.17, AFTER)):
            if rows.sum() < 5:
                continue
            box = axes.boxplot(
                y[rows],
                positions=[k + shift],
                widths=0.28,
                showfliers=False,
                whis=(5, 95),
                patch_artist=True,
                medianprops={"color": "0.1"},
            )
            box["boxes"][0].set(facecolor=colour, alpha=0.5)
    axes.set_xticks(range(3), [g[0] for g in groups])
    axes.set_xlim(-0.6, 2.6)
    axes.set_xlabel("direction of motion (box: quartiles, whiskers: 5 to 95 %)")
