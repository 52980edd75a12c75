"""Pictures of the page: all models, and each joint."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.thesis.nested_models.cells import FREQUENCIES
from benchmarks.thesis.nested_models.scores import ARM, ModelScores
from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.reporting.markdown import number, signed
from stiction_envs.reporting.png import save_full

SHOWN = ("inertia", "presliding", "elasticity", "offset", "drift", ARM)
"""Models drawn over each other."""
TABLES = {
    "4.6": ("o", "Table 4.6 (scale 1.0), fitted"),
    "4.7": ("^", "Table 4.7 (scale 1.2), held out"),
    "4.8": ("v", "Table 4.8 (scale 0.8), held out"),
    "4.10 intermediate": ("s", "Table 4.10 repeats, held out"),
    "4.10 final": ("D", "Table 4.10 final amplitude, held out"),
}
MEASURED = "#c2410c"
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


def joint(scores: ModelScores, j: int, path: Path) -> None:
    """Draw a joint's change of torque against frequency and amplitude, model after model.

    A column per pose and direction; above against frequency at scale 1.0, below against amplitude
    at the frequency the thesis chose for the joint.

    Args:
        scores: the models.
        j: the joint, from 1.
        path: PNG to write.
    """
    figure = Figure(figsize=(13.5, 8.0), layout="constrained")
    grid = figure.subplots(2, 4, sharey="row")
    colours = dict(
        zip(SHOWN, colormaps["viridis"](np.linspace(0.88, 0.05, len(SHOWN))), strict=True)
    )
    final = next(c.row for c in scores.cells if c.row.joint == j and c.row.table == "4.10")
    chosen = final.frequency_hz
    for column, where in zip(grid.T, configurations(7, [j]), strict=True):
        mine = [(i, c) for i, c in enumerate(scores.cells) if c.configuration == where]
        base = mine[0][1].row.tau_base_nm
        sign = plots.SIGNS[where.direction]
        title = f"{plots.POSES[where.load]}, {sign}   (base {signed(base, 2)} N·m)"
        column[0].set_title(title, fontsize=10)
        tables = ("4.6", "4.7", "4.8")
        over_f = sorted((c.row.frequency_hz, i) for i, c in mine if c.row.table in tables)
        over_a = sorted((c.row.amplitude_nm, i) for i, c in mine if c.row.frequency_hz == chosen)
        for axes, points in zip(column, (over_f, over_a), strict=True):
            for key in SHOWN:
                # above only scale 1.0, which is the fitted table
                at = [
                    (x, i) for x, i in points if axes is column[1] or not scores.cells[i].held_out
                ]
                values = [100 * scores.predicted[key][i] for _, i in at]
                last = key == ARM
                style: dict[str, Any] = {"lw": 2.4 if last else 1.3, "zorder": 4 if last else 3}
                axes.plot([x for x, _ in at], values, color=colours[key], **style)
            _cells(axes, scores, points)
            axes.axhline(0, color="0.3", lw=0.8, zorder=1)
            plots.plain_axes(axes)
        column[0].set_xscale("log")
        column[0].set_xticks(TICKS, [f"{f:g}" for f in TICKS])
        column[0].minorticks_off()
        column[0].set_xlim(13, 95)
        column[0].set_xlabel("frequency at scale 1.0 [Hz]")
        column[1].set_xlabel(f"amplitude at {chosen:g} Hz [N·m]")
        column[1].set_xlim(0, 1.08 * max(x for x, _ in over_a))
    drawn = scores.sound & (scores.joint == j)
    for axes, rows in zip(grid[:, 0], (True, scores.frequency == chosen), strict=True):
        axes.set_ylabel("change of the torque\nthat moves the joint [% of base]")
        values = [scores.measured, *(scores.predicted[k] for k in SHOWN[1:])]
        low, high = (100 * of(np.array(values)[:, drawn & rows]) for of in (np.min, np.max))
        margin = 0.08 * (high - low) + 2
        axes.set_ylim(low - margin, max(high, 0) + margin)
    handles = [
        *(
            Line2D([], [], color=c, lw=2.4 if k == ARM else 1.4, label=scores.models[k].name)
            for k, c in colours.items()
        ),
        *(
            Line2D([], [], marker=m, ls="", ms=6, label=text, **_face(name == "4.6"))
            for name, (m, text) in TABLES.items()
        ),
    ]
    band = scores.models["band"].name
    text = f"Joint {j}: measured and predicted change\n{band} is off the scale: −100 % at scale 1.0"
    figure.suptitle(text, fontsize=12)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    save_full(figure, path)


def _face(fitted: bool) -> dict[str, Any]:
    return {"color": MEASURED, "markerfacecolor": MEASURED if fitted else "white", "mew": 1.2}


def _cells(axes: Axes, scores: ModelScores, points: list[tuple[float, int]]) -> None:
    """Draw measured cells; the broken one is off the scale."""
    for x, i in points:
        c = scores.cells[i]
        if c.row.outlier:
            text, at = f"broken cell\n{number(100 * c.change, 0)} %", ("data", "axes fraction")
            style: dict[str, Any] = {"fontsize": 7.5, "ha": "center", "color": MEASURED}
            axes.annotate(text, (x, 0.02), xycoords=at, **style)
        else:
            marker = TABLES[c.column][0]
            axes.plot(x, 100 * c.change, marker, ms=5.5, zorder=6, **_face(not c.held_out))
