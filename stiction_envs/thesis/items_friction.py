"""Figure 2.3: friction over speed and its parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.robots import arm_title
from stiction_envs.thesis.friction_curve import FrictionCurve
from stiction_envs.thesis.items import Found, Item, Needs, Said, Written, say, write_figure
from stiction_envs.thesis.tables import TUNED

WHOLE, PARTS, POINTS = "#1f5fa8", "0.35", "#c2410c"


def curve_needs() -> Needs:
    """Return what the figure needs."""
    return {"curve": [TUNED]}


def write_curve(item: Item, found: Found, folder: Path) -> Written:
    """Draw Figure 2.3: the low-speed zone at the left, a hundred times as much at the right."""
    curve: FrictionCurve = found["curve"][TUNED]
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    zone = 3 * float(curve.stribeck.max())
    for axes, span in zip(
        figure.subplots(1, 2, sharey=True), (1.6 * zone, np.abs(curve.speed).max()), strict=True
    ):
        _draw(axes, curve, float(span), zone)
    figure.axes[0].set_ylabel("friction torque [N·m]")
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.suptitle(f"{arm_title(curve.robot)}, joint {curve.joint}", fontsize=11)
    return write_figure(item, folder, figure, say_curve(curve))


def _draw(axes: Axes, curve: FrictionCurve, span: float, zone: float) -> None:
    axes.axvspan(-zone, zone, color="0.9", zorder=0, label="low speeds: Stribeck effect")
    for k, sign in enumerate((1.0, -1.0)):
        v = sign * np.linspace(0, span, 400)[1:]
        axes.plot(v, curve.law(v), color=WHOLE, lw=2, label=None if k else "law of the model")
        level, slope = sign * curve.coulomb[k], curve.viscous[k]
        axes.plot(v, np.full_like(v, level), color=PARTS, lw=1, ls=(0, (5, 3)))
        axes.plot(v, slope * v, color=PARTS, lw=1, ls=(0, (1, 2)))
        stiction = sign * curve.stiction[k]
        axes.plot([0, 0], [0, stiction], color=WHOLE, lw=2)
        axes.plot(0, stiction, "o", color=WHOLE, ms=5)
        side = "left" if sign < 0 else "right"
        name = r"$\tau_S^+$" if sign > 0 else r"$\tau_S^-$"
        axes.annotate(
            name,
            (0, stiction),
            xytext=(-sign * 8, sign * 4),
            textcoords="offset points",
            ha=side,
            va="center",
            fontsize=11,
            color=WHOLE,
        )
    axes.plot([], [], color=PARTS, lw=1, ls=(0, (5, 3)), label="Coulomb friction")
    axes.plot([], [], color=PARTS, lw=1, ls=(0, (1, 2)), label="viscous friction")
    shown = np.abs(curve.speed) <= span
    axes.plot(
        curve.speed[shown],
        curve.torque[shown],
        "o",
        ms=4.5,
        mfc="white",
        color=POINTS,
        zorder=5,
        label="simulated at constant speed",
    )
    axes.axhline(0, color="0.6", lw=0.8)
    axes.set_xlim(-span, span)
    axes.set_xlabel("joint speed [rad/s]")
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def say_curve(curve: FrictionCurve) -> Said:
    """Return which parts of the figure the model has, and whether the simulation follows it."""
    off = 100 * np.abs(curve.torque / curve.law(curve.speed) - 1)
    fast = np.array([1.0, -1.0]) * float(np.abs(curve.speed).max())
    end = np.abs(curve.law(fast))
    return say(
        "curve",
        joint=curve.joint,
        stiction=curve.stiction.tolist(),
        drop=(100 * (1 - curve.coulomb / curve.stiction)).tolist(),
        stribeck=(1e3 * curve.stribeck).tolist(),
        off=float(off.max()),
        fastest=float(np.abs(curve.speed).max()),
        end=float(end.mean()),
        peak=float(curve.stiction.mean()),
        symmetric=bool(np.allclose(curve.stiction[0], curve.stiction[1])),
    )
