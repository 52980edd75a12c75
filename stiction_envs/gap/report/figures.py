"""Pictures of a diagnosis: error of each joint, each cause against what shows it, each joint."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from stiction_envs.arrays import Array, Index, rms
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.gap.judge.problem import ARM
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.series import Series
from stiction_envs.reporting.png import save_small

PLOTS = "plots"
"""Folder of the pictures, in the report's."""
BEFORE, AFTER, CAUSE, MEASURED = "#c2590c", "#1f5fa8", "0.1", "0.35"
DASHED = (0, (4, 2))
DOTS = 1500
"""Samples drawn per panel [-]; assumed."""
BINS = 36
"""Bins of a panel's mean and quartiles [-]; assumed."""
JOINTS = 3
"""Joints drawn per cause, the clearest first [-]; assumed."""
LONG = 4000
"""Samples drawn of a trace [-]; assumed."""
STRETCH = 12.0
"""Length of the motion that is drawn of each joint [s]; assumed."""
GAP = 5.0
"""Step between rows, over the usual one, that begins a new segment [-]; assumed."""


def _thin(count: int, most: int) -> Index:
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


def draw_errors(e: Errors, plots: Path) -> str:
    """Draw the error of each joint as a PNG; return it as Markdown with a caption, as all do."""
    x = np.arange(len(e.joints))
    figure = Figure(figsize=(max(4.4, 1.6 + 0.95 * len(x)), 3.4), layout="constrained")
    axes = figure.subplots()
    axes.vlines(x, e.nominal, e.extended, color="0.6", lw=2, zorder=1)
    axes.plot(x, e.nominal, "o", color=BEFORE, ms=8, label="nominal")
    axes.plot(x, e.extended, "o", color=AFTER, ms=8, label="extended")
    axes.plot(x, e.noise, "_", color="0.1", ms=26, mew=1.6, label="noise floor")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(x, [f"joint {j}" for j in e.joints])
    axes.set_xlim(-0.6, len(x) - 0.4)
    axes.margins(y=0.12)
    axes.set_ylabel(f"error [{e.unit}]")
    tidy(axes, zero=False)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    return _saved(figure, plots / "summary.png", f"{e.what}.")


def draw_cause(d: Diagnosis, cause: NamedCause, plots: Path) -> str:
    """Draw a cause: residual without it and its torque above, residual with it below."""
    data, view = d.data, cause_named(cause.name).view
    effect = d.cause_torque(cause.name)
    clear = rms(effect) / data.noise
    of = [j - 1 for j in cause.joints] or list(range(data.n))
    shown = sorted(sorted(of, key=lambda j: -clear[j])[:JOINTS])
    # layouts that matplotlib works out take as long as all the drawing
    width = max(6.8, 1.4 + 3.4 * len(shown))
    figure = Figure(figsize=(width, 5.6))
    figure.subplots_adjust(
        left=0.85 / width, right=1 - 0.15 / width, top=0.89, bottom=0.15, hspace=0.3
    )
    grid = figure.subplots(2, len(shown), squeeze=False, sharex="col", sharey="col")
    for (upper, lower), j in zip(grid.T, shown, strict=True):
        term = next(
            t for t in d.terms if t.cause == cause.name and t.joint in (j, ARM) and not t.small
        )
        after, alone, speed = data.residual[:, j] - d.torque[:, j], effect[:, j], data.dq[:, j]
        x = alone if view.of is None else view.of(data, j, term.shape).astype(np.float64)
        rows = np.abs(x) < (np.inf if view.limit is None else view.limit(term.shape))
        rows &= (np.abs(speed) > 1e-3) | (not view.folded)
        sign = np.sign(speed[rows]) if view.folded else 1.0
        x, before, after, alone = x[rows], *(sign * y[rows] for y in (after + alone, after, alone))
        _dots(upper, x, before, BEFORE)
        centre, middle, *_ = _binned(x, alone)
        upper.plot(centre, middle, color=CAUSE, lw=1.4, ls=DASHED)
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
    handles = [
        Line2D([], [], color=BEFORE, label="residual without it"),
        Line2D([], [], color=CAUSE, ls=DASHED, label="what the cause predicts"),
        Line2D([], [], color=AFTER, label="residual with it"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3, fontsize=8.5, frameon=False)
    figure.suptitle(f"{cause.name}: {view.note}", fontsize=10.5)
    caption = (
        f"{cause.name}: residual torque{folded} against {view.label}. Above without this cause "
        "(all others taken out), dashed what the cause predicts; below with it. "
        f"Line: mean, band: quartiles. Look for: {view.note}."
    )
    return _saved(figure, plots / f"cause_{cause.name}.png", caption)


def draw_joint(s: Series, joint: int, plots: Path) -> str:
    """Draw a joint (from 0): its fastest motion, and its residual against everything."""
    t, segment = _joined(s.time)
    style = "." if s.at_rest else "-"
    angles = s.quantity == "angle"
    scale, unit = (1e3, "mrad") if angles else (1.0, "N·m")
    measured, nominal, model = (x[:, joint] for x in (s.measured, s.nominal, s.simulated))
    figure = Figure(figsize=(11.5, 6.2))
    figure.subplots_adjust(left=0.07, right=0.99, top=0.92, bottom=0.09, hspace=0.3, wspace=0.06)
    grid = figure.add_gridspec(2, 3)
    top = figure.add_subplot(grid[0, :])
    near = _fastest(t, (s.q if s.q_cmd is None else s.q_cmd)[:, joint])
    lines = {"nominal": (nominal, BEFORE), "measured": (measured, MEASURED)}
    lines["extended"] = model, AFTER
    if s.q_cmd is not None:
        lines = {"commanded": (s.q_cmd[:, joint], "0.75")} | lines
    for name, (y, colour) in lines.items():
        look = {"color": colour, "label": name, "lw": 1.6 if name == "measured" else 1.0}
        _trace(top, t[near], y[near], segment[near], style, **look)
    top.set_ylabel(f"{s.quantity} [{'rad' if angles else unit}]", fontsize=9)
    top.set_title(f"joint {joint + 1}", fontsize=11, loc="left")
    top.legend(fontsize=8, frameon=False, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    clock = "number of the pose" if s.at_rest else "time without pauses [s]"
    top.set_xlabel(clock, fontsize=9)
    tidy(top, zero=False)
    rows = np.ones(len(t), dtype=bool) if s.contact is None else ~s.contact
    left = [
        (np.where(rows, scale * (measured - y), np.nan), colour)
        for y, colour in ((nominal, BEFORE), (model, AFTER))
    ]
    limit = 1.3 * max(float(np.nanpercentile(np.abs(y), 99.5)) for y, _ in left) + 1e-9
    against = {"angle [rad]": s.q} | ({} if s.dq is None else {"speed [rad/s]": s.dq})
    over_time = figure.add_subplot(grid[1, : 3 - len(against)])
    over_time.set_ylabel(f"measured less simulated [{unit}]", fontsize=9)
    panels = {clock: over_time}
    for k, label in enumerate(against, start=3 - len(against)):
        panels[label] = figure.add_subplot(grid[1, k], sharey=over_time)
        panels[label].tick_params(labelleft=False)
    for y, colour in left:
        _trace(over_time, t, y, segment, style, color=colour)
        for label, x in against.items():
            _dots(panels[label], x[rows, joint], y[rows], colour)
    for label, axes in panels.items():
        axes.set_xlabel(label, fontsize=9)
        axes.xaxis.set_major_locator(MaxNLocator(6))
        tidy(axes)
    over_time.set_ylim(-limit, limit)
    contact = ", without contact" if s.contact is not None and s.contact.any() else ""
    caption = (
        f"Joint {joint + 1}: {STRETCH:g} s of its fastest motion; below what is left over all of "
        f"the logs{contact} (orange: nominal, blue: extended). Line: mean, band: quartiles."
    )
    return _saved(figure, plots / f"joint_{joint + 1}.png", caption)


def _saved(figure: Figure, path: Path, caption: str) -> str:
    save_small(figure, path)
    return f"![{path.stem.replace('_', ' ')}]({PLOTS}/{path.name})\n\n{caption}"


def _joined(time: Array) -> tuple[Array, Index]:
    """Return (T,) time without the pauses between segments [s], and the number of each segment."""
    step = np.diff(time, prepend=time[0])
    usual = float(np.median(step))
    pause = step > GAP * usual
    return np.cumsum(np.where(pause, usual, step)), np.cumsum(pause)


def _fastest(t: Array, q: Array) -> Index:
    """Return the rows of the `STRETCH` in which a joint moves most."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    begin = t[int(np.argmax(np.interp(t + STRETCH, t, path) - path))]
    return np.flatnonzero((t >= begin) & (t <= begin + STRETCH))


def _trace(axes: Axes, t: Array, y: Array, segment: Index, style: str, **look: Any) -> None:
    """Draw a signal over time, with gaps between segments."""
    at = _thin(len(t), LONG)
    y = y[at].copy()
    if style == "-":
        y[np.flatnonzero(np.diff(segment[at]))] = np.nan
    axes.plot(t[at], y, style, **{"lw": 1.0, **look})
