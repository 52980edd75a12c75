"""Pictures of a diagnosis: each cause against the variable that shows it, each joint's residual."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.signal import welch

from stiction_envs.gap.candidates import ARM, Term
from stiction_envs.gap.diagnosis import Diagnosis, NamedCause
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.reporting.png import save_small

Array = NDArray[np.float64]
BEFORE, AFTER, CAUSE, MEASURED = "#c2590c", "#1f5fa8", "0.1", "0.35"
LINES: tuple[tuple[str, Any], ...] = ((BEFORE, "-"), (CAUSE, (0, (4, 2))), (AFTER, "-"))
DOTS = 1500
"""Samples drawn per panel."""
BINS = 36
JOINTS = 3
"""Joints drawn per cause, the clearest first."""
LONG = 4000
"""Samples drawn of a trace."""


@dataclass(frozen=True)
class View:
    """What a cause is drawn against."""

    label: str
    of: Callable[[Data, int, Term], Array]
    """(T,) of a joint (from 0)."""
    folded: bool = False
    """Whether torques are counted in the direction of motion."""
    note: str = ""
    """What to look for, a clause."""


def _since_reversal(data: Data, joint: int, term: Term) -> Array:
    """Return (T,) way since the joint last turned round [rad]."""
    out = np.zeros(len(data.t))
    for run in data.runs():
        q = data.q[run, joint]
        sign = np.sign(np.diff(q, prepend=q[0]))
        turned = np.flatnonzero(np.diff(sign) != 0) + 1
        start = np.zeros(len(q), dtype=int)
        start[turned] = turned
        start = np.maximum.accumulate(start)
        out[run] = np.abs(q - q[start])
    return out


def _phase(data: Data, joint: int, term: Term) -> Array:
    periods = term.shape[0] if term.shape else 1.0
    return np.mod(periods * data.q[:, joint] / (2 * np.pi), 1.0)


def _rate(signal: Array, data: Data) -> Array:
    out = np.zeros_like(signal)
    for run in data.runs():
        if run.stop - run.start > 2:
            out[run] = np.gradient(signal[run], data.dt)
    return out


def _angle(data: Data, joint: int, term: Term) -> Array:
    return data.q[:, joint]


def _speed(data: Data, joint: int, term: Term) -> Array:
    return data.dq[:, joint]


def _predicted(data: Data, joint: int, term: Term) -> Array:
    return np.zeros(len(data.t))  # replaced by the cause's own torque


OWN = View(
    "torque that the cause predicts [N·m]",
    _predicted,
    note="on the diagonal the cause is right in every pose",
)
VIEWS: dict[str, View] = {
    "coulomb_friction": View(
        "joint speed [rad/s]", _speed, note="a step where the motion turns round"
    ),
    "viscous_friction": View("joint speed [rad/s]", _speed, note="a slope with speed"),
    "stribeck_friction": View(
        "joint speed [rad/s]", _speed, note="friction falls as the joint gets faster"
    ),
    "direction_asymmetry": View(
        "joint speed [rad/s]", _speed, note="both directions lie off zero to the same side"
    ),
    "load_dependent_friction": View(
        "transmitted torque [N·m]",
        lambda d, j, t: np.abs(d.rigid[:, j]),
        folded=True,
        note="friction grows with load",
    ),
    "presliding_hysteresis": View(
        "way since the last reversal [rad]",
        _since_reversal,
        folded=True,
        note="friction builds up over some way after a reversal",
    ),
    "position_dependent_friction": View(
        "joint angle, part of one ripple period [-]", _phase, note="a sine, once per period"
    ),
    "warm_up_drift": View(
        "time [s]", lambda d, j, t: d.t, folded=True, note="friction changes along the record"
    ),
    "torque_offset": View("joint angle [rad]", _angle, note="the same torque everywhere"),
    "torque_scale": View(
        "nominal torque [N·m]",
        lambda d, j, t: d.nominal[:, j],
        note="a slope: an error in proportion to the torque",
    ),
    "payload": OWN,
    "base_tilt": OWN,
    "link_inertia": View(
        "joint acceleration [rad/s²]", lambda d, j, t: d.ddq[:, j], note="a slope through zero"
    ),
    "backlash": View(
        "transmitted torque [N·m]", lambda d, j, t: d.rigid[:, j], note="a dent about zero load"
    ),
    "joint_elasticity": OWN,
    "actuator_delay": View(
        "rate of the nominal torque [N·m/s]",
        lambda d, j, t: _rate(d.nominal[:, j], d),
        note="a slope: torque that comes late",
    ),
    "external_spring": View("joint angle [rad]", _angle, note="a slope: a pull with position"),
}


@dataclass(frozen=True)
class Drawn:
    """One picture and what it shows."""

    file: str
    caption: str


def _sign(data: Data, joint: int) -> Array:
    return np.sign(data.dq[:, joint])


def _thin(count: int, most: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _binned(x: Array, y: Array, bins: int = BINS) -> tuple[Array, Array, Array, Array]:
    """Return centres, means, quartiles of bins of equal width within the 0.5th percentiles."""
    low, high = np.percentile(x, [0.5, 99.5])
    if not high > low:
        return x[:0], x[:0], x[:0], x[:0]
    which = np.clip(((x - low) / (high - low) * bins).astype(int), 0, bins - 1)
    inside = (x >= low) & (x <= high)
    out = []
    for k in range(bins):
        y_k = y[inside & (which == k)]
        if len(y_k) >= max(5, len(y) // (100 * bins)):
            centre = low + (k + 0.5) * (high - low) / bins
            out.append((centre, y_k.mean(), *np.percentile(y_k, [25, 75])))
    return tuple(np.array(out).reshape(-1, 4).T)  # type: ignore[return-value]


def _dots(axes: Axes, x: Array, y: Array, colour: str, label: str) -> None:
    """Draw samples, the mean and the quartiles of bins; the axis leaves out far-off samples."""
    at = _thin(len(x), DOTS)
    axes.plot(x[at], y[at], ".", ms=2, color=colour, alpha=0.35, mew=0, rasterized=True)
    centre, middle, low, high = _binned(x, y)
    axes.fill_between(centre, low, high, color=colour, alpha=0.25, lw=0)
    axes.plot(centre, middle, color=colour, lw=1.6, label=label)
    left, right = np.percentile(x, [0.3, 99.7])
    if right > left:
        room = 0.06 * (right - left)
        axes.set_xlim(left - room, right + room)


def _tidy(axes: Axes) -> None:
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.axhline(0, color="0.6", lw=0.7, zorder=0)


def draw_cause(d: Diagnosis, cause: NamedCause, path: Path) -> Drawn:
    """Draw a cause: residual without it and its torque above, residual with it below.

    Args:
        d: the diagnosis.
        cause: one of its causes.
        path: PNG to write.
    """
    data, view = d.data, VIEWS[cause.name]
    effect = _torques(d, cause.name)
    clear = np.sqrt(np.mean(np.square(effect), axis=0)) / data.noise
    of = [j - 1 for j in cause.joints] or list(range(data.n))
    shown = sorted(sorted(of, key=lambda j: -clear[j])[:JOINTS])
    figure = Figure(figsize=(max(6.8, 1.4 + 3.4 * len(shown)), 5.6), layout="constrained")
    grid = figure.subplots(2, len(shown), squeeze=False, sharex="col", sharey="col")
    for column, j in enumerate(shown):
        term = next(t for t in d.terms if t.cause == cause.name and t.joint in (j, ARM))
        after = data.residual[:, j] - d.torque(j)
        before, own = after + effect[:, j], effect[:, j]
        x = own if view.of is _predicted else view.of(data, j, term)
        rows = np.ones(len(x), dtype=bool)
        if view.folded:
            rows = np.abs(data.dq[:, j]) > 1e-3
            before, after, own = (y * _sign(data, j) for y in (before, after, own))
        if cause.name == "stribeck_friction" and term.shape:
            rows = np.abs(x) < max(6 * term.shape[0], 0.02)
        if cause.name == "presliding_hysteresis" and term.shape:
            rows &= x < 8 * term.shape[0]
        x, before, after, own = x[rows], before[rows], after[rows], own[rows]
        upper, lower = grid[0, column], grid[1, column]
        _dots(upper, x, before, BEFORE, "residual without it")
        centre, middle, *_ = _binned(x, own)
        upper.plot(centre, middle, color=CAUSE, lw=1.4, ls=(0, (4, 2)), label="the cause")
        _dots(lower, x, after, AFTER, "residual with it")
        upper.set_title(f"joint {j + 1}", fontsize=10, loc="left")
        lower.set_xlabel(view.label, fontsize=9)
        low, high = np.percentile(np.concatenate([before, after]), [0.5, 99.5])
        low, high = min(low, 0.0), max(high, 0.0)
        room = 0.15 * (high - low) + 1e-9
        upper.set_ylim(low - room, high + room)
        for axes in (upper, lower):
            _tidy(axes)
            axes.tick_params(labelsize=8)
    folded = " in the direction of motion" if view.folded else ""
    for row, text in enumerate(("without", "with")):
        grid[row, 0].set_ylabel(f"residual{folded},\n{text} the cause [N·m]", fontsize=9)
    handles = [Line2D([], [], color=c, ls=s) for c, s in LINES]
    names = ["residual without it", "what the cause predicts", "residual with it"]
    figure.legend(handles, names, loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)
    figure.suptitle(f"{cause.name}: {view.note}", fontsize=10.5)
    save_small(figure, path)
    return Drawn(
        path.name,
        f"{cause.name}: residual torque{folded} against {view.label}. Above without this cause "
        "(all others taken out), dashed what the cause predicts; below with it. "
        f"Line: mean, band: quartiles. Look for: {view.note}.",
    )


def _torques(d: Diagnosis, cause: str) -> Array:
    """Return (T, n) torque of one cause."""
    out = np.zeros_like(d.data.q)
    for term, mine in zip(d.terms, d.library.split(d.terms, d.coefficients), strict=True):
        if term.cause == cause:
            for j in d.library.reach(term):
                out[:, j] += d.library.columns(term, j) @ mine
    return out


def draw_joint(d: Diagnosis, joint: int, path: Path) -> Drawn:
    """Draw a joint's torque and its residual against everything.

    Args:
        d: the diagnosis.
        joint: from 0.
        path: PNG to write.
    """
    data = d.data
    before = data.residual[:, joint]
    after = before - d.torque(joint)
    figure = Figure(figsize=(11.5, 8.2), layout="constrained")
    grid = figure.add_gridspec(3, 3)
    top, under = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[0, 2])
    clock = _clock(data)
    _trace(top, clock, data.tau[:, joint], data, MEASURED, "measured", 1.6)
    _trace(top, clock, data.nominal[:, joint], data, BEFORE, "nominal", 0.9)
    _trace(top, clock, data.nominal[:, joint] + d.torque(joint), data, AFTER, "extended", 0.9)
    top.set_ylabel("torque [N·m]")
    still = not np.isfinite(data.dt)
    top.set_xlabel("number of the pose" if still else "time, segments one after another [s]")
    top.legend(fontsize=8, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    _spectrum(under, data, before, after, float(data.noise[joint]))
    time = figure.add_subplot(grid[1, 0])
    for y, colour in ((before, BEFORE), (after, AFTER)):
        _trace(time, clock, y, data, colour, "", 0.8)
    _limits(time, before)
    time.set_xlabel("number of the pose" if still else "time [s]")
    views: list[tuple[str, Array]] = [
        ("angle [rad]", data.q[:, joint]),
        ("speed [rad/s]", data.dq[:, joint]),
        ("transmitted torque [N·m]", data.rigid[:, joint]),
        ("acceleration [rad/s²]", data.ddq[:, joint]),
    ]
    places = [(1, 1), (1, 2), (2, 1), (2, 2)]
    all_axes = [top, time]
    for (label, x), place in zip(views, places, strict=True):
        axes = figure.add_subplot(grid[place])
        _dots(axes, x, before, BEFORE, "nominal")
        _dots(axes, x, after, AFTER, "extended")
        _limits(axes, before)
        axes.set_xlabel(label)
        axes.xaxis.set_major_locator(MaxNLocator(6))
        all_axes.append(axes)
    box = figure.add_subplot(grid[2, 0])
    _directions(box, data.dq[:, joint], before, after)
    _limits(box, before)
    all_axes.append(box)
    for axes in all_axes:
        _tidy(axes)
    for axes in (time, box):
        axes.set_ylabel("residual [N·m]")
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.xaxis.label.set_fontsize(9)
        axes.yaxis.label.set_fontsize(9)
    figure.legend(
        handles=[Line2D([], [], color=BEFORE), Line2D([], [], color=AFTER)],
        labels=["residual of the nominal model", "residual of the extended model"],
        loc="outside upper right",
        ncols=2,
        fontsize=9,
        frameon=False,
    )
    figure.suptitle(f"joint {joint + 1}", x=0.02, ha="left", fontsize=12)
    save_small(figure, path)
    return Drawn(path.name, f"Joint {joint + 1}: torque, and residual against everything.")


def _clock(data: Data) -> Array:
    """Return (T,) time with the segments put one after another [s]; numbers of poses."""
    if not np.isfinite(data.dt):
        return np.arange(float(len(data.t)))
    step = np.diff(data.t, prepend=data.t[0])
    new = np.diff(data.segment, prepend=data.segment[0]) != 0
    return np.cumsum(np.where(new | (step < 0), 0.0, step))


def _trace(
    axes: Axes, x: Array, y: Array, data: Data, colour: str, label: str, width: float
) -> None:
    at = _thin(len(x), LONG)
    if not np.isfinite(data.dt):
        axes.plot(x[at], y[at], ".", ms=3, mew=0, color=colour, label=label)
        return
    y = y[at].copy()
    y[np.flatnonzero(np.diff(data.segment[at]))] = np.nan
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
        axes.loglog(f[1:], np.sqrt(power[1:]), color=colour, lw=1)
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
    """Draw how residuals of poses are spread, which have no spectrum."""
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
