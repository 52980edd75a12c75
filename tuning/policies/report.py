"""The curve of a training, and the means of evaluated policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.reporting.markdown import number
from stiction_envs.reporting.png import save_full

if TYPE_CHECKING:
    from tuning.policies.train import CurvePoint

COLUMNS = {
    "return": ("return", 1.0, 3),
    "return_error": ("±", 1.0, 3),
    "reduction": ("reduction", 1.0, 3),
    "position_left_m": ("left [mm]", 1e3, 3),
    "orientation_left_rad": ("[mrad]", 1e3, 3),
    "vibration_moving_mm": ("moving [mm]", 1.0, 3),
    "vibration_at_rest_mm": ("at rest [mm]", 1.0, 3),
    "oscillation_mrad": ("shaking [mrad]", 1.0, 2),
    "power": ("power", 1.0, 3),
}
"""Means that are shown: heading, factor, digits."""


def means_table(summary: Mapping[str, Mapping[str, float]]) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of `Evaluated.summary`, one row per policy."""
    shown = [c for c in COLUMNS if c in next(iter(summary.values()))]
    rows = [
        [policy, *(number(means[c] * COLUMNS[c][1], COLUMNS[c][2]) for c in shown)]
        for policy, means in summary.items()
    ]
    return ["policy", *(COLUMNS[c][0] for c in shown)], rows


POLICY, NONE = "#1f5fa8", "#d1701a"


def draw_curve(path: Path, points: Sequence[CurvePoint], *, title: str, experiment: str) -> None:
    """Draw returns over steps; the shade is the standard deviation over the episodes."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    steps = np.array([p.steps for p in points])
    mean = np.array([p.evaluation_return for p in points])
    spread = np.array([p.evaluation_std for p in points])
    axes.fill_between(steps, mean - spread, mean + spread, color=POLICY, alpha=0.15, lw=0)
    axes.plot(steps, mean, "o-", ms=3, color=POLICY, label="evaluation, ± std of episodes")
    best = int(np.argmax(mean))
    axes.plot(steps[best], mean[best], "o", ms=9, mfc="none", color=POLICY, label="kept")
    kind = EXPERIMENTS[experiment]
    if kind.undithered_return is not None:
        axes.axhline(kind.undithered_return, color=NONE, ls="--", lw=1, label="no dither")
    axes.set_xlabel("steps of all arms")
    axes.set_ylabel(kind.returns)
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    save_full(figure, path)
