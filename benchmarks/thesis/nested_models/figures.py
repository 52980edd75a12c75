"""Pictures of the page: all models, each joint, what is left, the iiwa's phase."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchmarks.thesis.nested_models.phase import PhaseStudy
from benchmarks.thesis.nested_models.scores import ARM, FREQUENCIES, TARGETS, ModelScores
from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.reporting.png import save_full

Array = NDArray[np.float64]
SHOWN = ("inertia", "presliding", "elasticity", "offset", "drift", ARM)
"""Models drawn over each other, where there are any."""
THEORY = {
    "creep": ("theory: bristles shaken, the joint creeps", (0, (4, 2))),
    "slip": ("theory: bristles as a spring, first slip", (0, (1, 1.5))),
}
AVERAGED = "theory: averaging, speed with friction to speed without"
TABLES = {
    "4.6": ("o", "Table 4.6 (scale 1.0), fitted"),
    "4.7": ("^", "Table 4.7 (scale 1.2), held out"),
    "4.8": ("v", "Table 4.8 (scale 0.8), held out"),
    "4.10 intermediate": ("s", "Table 4.10 repeats, held out"),
    "4.10 final": ("D", "Table 4.10 final amplitude, held out"),
}
MEASURED, THEORY_COLOUR, BROKEN = "#c2410c", "0.45", "x"
TICKS = sorted(FREQUENCIES)


def models(scores: ModelScores, path: Path) -> None:
    """Draw mean, interval and median held-out error of every model.

    Args:
        scores: the models.
        path: PNG to write.
    """
    drawn = list(scores.scores.values())
    figure = Figure(figsize=(9, 0.36 * len(drawn) + 1.9), layout="constrained")
    axes = figure.subplots()
    y = np.arange(len(drawn))[::-1]
    mean = np.array([s.mean for s in drawn])
    spread = np.abs(np.array([[s.low, s.high] for s in drawn]).T - mean)
    axes.errorbar(mean, y, xerr=spread, fmt="o", color="#1f5fa8", capsize=3, label="mean, 95 %")
    axes.plot([s.median for s in drawn], y, "|", ms=13, mew=2, color="#d1701a", label="median")
    axes.axvline(scores.floor[0], color="0.4", ls="--", lw=1, label="the thesis's repeats, mean")
    axes.axvline(TARGETS["mean"], color="0.4", ls=":", lw=1, label="target, mean")
    axes.set_yticks(y, [s.name for s in drawn])
    axes.set_xscale("log")
    ticks = [2, 3, 5, 10, 20, 50, 100]
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.minorticks_off()
    axes.set_xlim(1.5, 120)
    axes.set_xlabel("held-out error, |predicted − measured| / |τ_base| [%]")
    axes.set_title("Tables 4.7, 4.8 and 4.10 of the thesis, predicted from 4.3 and 4.6")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    save_full(figure, path)


# ---- one joint -----------------------------------------------------------------------------------


def joint(scores: ModelScores, number: int, path: Path) -> None:
    """Draw a joint's change of torque against frequency and amplitude, model after model.

    A column per pose and direction; above against frequency at scale 1.0, below against amplitude
    at the frequency the thesis chose for the joint.

    Args:
        scores: the models.
        number: the joint, from 1.
        path: PNG to write.
    """
    figure = Figure(figsize=(13.5, 8.0), layout="constrained")
    grid = figure.subplots(2, 4, sharey="row")
    shown = [k for k in SHOWN if k in scores.models] or [scores.last]
    colours = colormaps["viridis"](np.linspace(0.88, 0.05, len(shown)))
    chosen = _chosen_frequency(scores, number)
    for column, where in enumerate(configurations(7, [number])):
        above, below = grid[0, column], grid[1, column]
        sign = plots.SIGNS[where.direction]
        base = next(c.row.tau_base_nm for c in scores.cells if c.configuration == where)
        above.set_title(
            f"{plots.POSES[where.load]}, {sign}   (base {base:+.2f} N·m)".replace("-", "−").replace(
                "no−load", "no-load"
            ),
            fontsize=10,
        )
        for axes, against in ((above, "frequency"), (below, "amplitude")):
            _theory(axes, scores, where, against, chosen)
            for key, colour in zip(shown, colours, strict=True):
                _model(axes, scores, where, key, against, chosen, colour, last=key == shown[-1])
            _points(axes, scores, where, against, chosen)
            axes.axhline(0, color="0.3", lw=0.8, zorder=1)
            axes.grid(alpha=0.25, lw=0.6)
            axes.spines[["top", "right"]].set_visible(False)
        above.set_xscale("log")
        above.set_xticks(TICKS, [f"{f:g}" for f in TICKS])
        above.minorticks_off()
        above.set_xlim(13, 95)
        above.set_xlabel("frequency at scale 1.0 [Hz]")
        below.set_xlabel(f"amplitude at {chosen:g} Hz [N·m]")
        below.set_xlim(left=0)
    for axes in grid[:, 0]:
        axes.set_ylabel("change of the torque\nthat moves the joint [% of base]")
    for axes, against in zip(grid[:, 0], ("frequency", "amplitude"), strict=True):
        axes.set_ylim(*_limits(scores, number, shown, against, chosen))
    handles = [
        Line2D([], [], color=c, lw=2.4 if k == shown[-1] else 1.4, label=scores.models[k].name)
        for k, c in zip(shown, colours, strict=True)
    ]
    handles += [
        Line2D([], [], color=THEORY_COLOUR, ls=style, lw=1.2, label=text)
        for text, style in THEORY.values()
    ]
    handles.append(Line2D([], [], color="0.5", alpha=0.25, lw=7, label=AVERAGED))
    handles += [
        Line2D([], [], marker=m, ls="", ms=6, label=text, **_face(name == "4.6"))
        for name, (m, text) in TABLES.items()
    ]
    band = scores.models.get("band")
    text = "" if band is None else f"\n{band.name} is off the scale: −100 % at scale 1.0"
    figure.suptitle(f"Joint {number}: measured and predicted change{text}", fontsize=12)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    save_full(figure, path)


def _chosen_frequency(scores: ModelScores, number: int) -> float:
    """Return the frequency of the joint in Table 4.10 [Hz]."""
    mask = (scores.joint == number) & np.char.startswith(scores.table.astype(str), "4.10")
    return float(scores.frequency[mask][0])


def _select(
    scores: ModelScores, where: Configuration, against: str, chosen: float
) -> list[tuple[float, int]]:
    """Return (x, cell) of the cells in a panel, sorted."""
    out = []
    for i, c in enumerate(scores.cells):
        if c.configuration != where:
            continue
        if against == "amplitude" and c.row.frequency_hz == chosen:
            out.append((c.row.amplitude_nm, i))
        elif against == "frequency" and c.row.table in ("4.6", "4.7", "4.8"):
            out.append((c.row.frequency_hz, i))
    return sorted(out)


def _face(fitted: bool) -> dict[str, Any]:
    return {"color": MEASURED, "markerfacecolor": MEASURED if fitted else "white", "mew": 1.2}


def _points(
    axes: Axes, scores: ModelScores, where: Configuration, against: str, chosen: float
) -> None:
    for x, i in _select(scores, where, against, chosen):
        c = scores.cells[i]
        marker = TABLES[c.column][0]
        y = 100 * c.change
        if c.row.outlier:
            axes.annotate(
                f"broken cell\n{y:.0f} %".replace("-", "−"),
                (x, 0.02),
                xycoords=("data", "axes fraction"),
                fontsize=7.5,
                ha="center",
                color=MEASURED,
            )
            continue
        axes.plot(x, y, marker, ms=5.5, zorder=6, **_face(not c.held_out))


def _model(
    axes: Axes,
    scores: ModelScores,
    where: Configuration,
    key: str,
    against: str,
    chosen: float,
    colour: Any,
    *,
    last: bool,
) -> None:
    points = [
        (x, 100 * scores.predicted[key][i])
        for x, i in _select(scores, where, against, chosen)
        if against == "amplitude" or not scores.cells[i].held_out
    ]
    if points:
        x, y = zip(*points, strict=True)
        axes.plot(x, y, color=colour, lw=2.4 if last else 1.3, zorder=4 if last else 3)


def _theory(
    axes: Axes, scores: ModelScores, where: Configuration, against: str, chosen: float
) -> None:
    theory = scores.theory(where.joint)
    base = next(
        abs(c.row.tau_base_nm)
        for c in scores.cells
        if c.configuration == where and c.row.table == "4.6"
    )
    if against == "frequency":
        x = np.geomspace(13, 95, 160)
        f, a = x, np.full_like(x, base)
    else:
        most = max(x for x, _ in _select(scores, where, against, chosen))
        x = np.linspace(0, 1.08 * most, 160)
        f, a = np.full_like(x, chosen), x
    free, sliding = (100 * theory.change(kind, where, f, a) for kind in ("free", "sliding"))
    axes.fill_between(x, free, sliding, color="0.5", alpha=0.16, lw=0, zorder=1)
    for kind, (_, style) in THEORY.items():
        y = 100 * theory.change(kind, where, f, a)
        if kind == "creep":  # of a joint that sticks
            y = np.where(theory.sticks(f, a, where.index[1]), y, np.nan)
        axes.plot(x, y, color=THEORY_COLOUR, ls=style, lw=1.2, zorder=2)


def _limits(
    scores: ModelScores, number: int, shown: Sequence[str], against: str, chosen: float
) -> tuple[float, float]:
    """Return limits [%] of a row: all its sound cells, and all drawn models but the first."""
    drawn = [
        i
        for where in configurations(7, [number])
        for _, i in _select(scores, where, against, chosen)
    ]
    mine = np.isin(np.arange(len(scores.cells)), drawn) & scores.sound
    values = [scores.measured[mine], *(scores.predicted[k][mine] for k in shown[1:] or shown)]
    low, high = 100 * np.min(np.concatenate(values)), 100 * np.max(np.concatenate(values))
    margin = 0.08 * (high - low) + 2
    return float(low - margin), float(max(high, 0) + margin)


# ---- the iiwa ------------------------------------------------------------------------------------


def iiwa(study: PhaseStudy, path: Path) -> None:
    """Draw simulated change over the phase of the dither, with the measured cells.

    Args:
        study: the simulated phases.
        path: PNG to write.
    """
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
    degrees = np.degrees(study.phase)
    colours = colormaps["tab10"](np.arange(len(study.rows)) % 10)
    names = [
        f"joint {r.joint} {'L' if r.load == 'load' else 'N'}{plots.SIGNS[r.direction]}"
        for r in study.rows
    ]
    for values, colour, name in zip(100 * study.change, colours, names, strict=True):
        left.plot(degrees, values, "o-", ms=3.5, lw=1.4, color=colour, label=name)
    left.set_xticks(np.linspace(0, 90, 7))
    left.set_xlabel("phase φ between dither and controller clock [°]")
    left.set_ylabel("change of the torque that moves the joint [%]")
    rate = study.controller_rate_hz
    tone = " and ".join(f"{f:g}" for f in dict.fromkeys(r.frequency_hz for r in study.rows))
    left.set_title(f"simulated: {tone} Hz commanded at {rate:g} Hz is ±A sin φ", fontsize=10.5)
    left.legend(frameon=False, fontsize=8)
    x = np.arange(len(study.rows))
    low, high = 100 * study.change.min(axis=1), 100 * study.change.max(axis=1)
    text = "simulated, φ from 0° to 90°"
    right.bar(x, high - low, 0.5, bottom=low, color="#9bbcdf", label=text, zorder=3)
    right.plot(x, 100 * study.measured, "D", color=MEASURED, ms=7, label="measured", zorder=4)
    for k, value in enumerate(100 * study.measured):
        right.annotate(
            f"{value:+.0f}".replace("-", "−"),
            (k, value),
            xytext=(9, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            color=MEASURED,
        )
    right.set_xticks(x, names, rotation=30, ha="right", fontsize=8.5)
    right.set_xlim(-0.6, len(x) - 0.1)
    right.set_ylabel("change of torque [%]")
    right.set_xlabel("pose (L load, N no load) and direction of the ramp")
    right.set_title("measured (thesis Table 4.5) and what phase can do", fontsize=10.5)
    right.legend(frameon=False, fontsize=8.5)
    for axes in (left, right):
        axes.axhline(0, color="0.3", lw=0.8, zorder=2)
        axes.grid(alpha=0.25, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle("LBR iiwa 7 R800: dither at half the controller's rate", fontsize=12)
    save_full(figure, path)
