"""The curve of a training: ``curve.csv`` and ``curve.png``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.png import save_full

POLICY, TRAINING, NONE = "#1f5fa8", "#8a8a8a", "#d1701a"
UNITS = {
    "sje": "return [1 − |τ_SJE| / |τ_base|, less penalties]",
    "gte": "return [−error / undithered error, less penalties]",
}
"""What a return is, per experiment."""
UNDITHERED = {"sje": 0.0, "gte": -1.0}
"""Mean return without dither, by definition of the rewards."""


def write_curve(path: Path, points: Sequence[Any]) -> None:
    """Write a row per evaluation; see `callbacks.CurvePoint` for the columns."""
    rows = [dataclasses.asdict(p) for p in points]
    write_lines(path, tuple(rows[0]), [tuple(row.values()) for row in rows])


def draw_curve(path: Path, points: Sequence[Any], *, title: str, experiment: str) -> None:
    """Draw returns over steps; the shade is the spread of the evaluation's episodes.

    Args:
        path: of the PNG.
        points: `callbacks.CurvePoint`.
        title: of the picture.
        experiment: one of `UNITS`.
    """
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    steps = np.array([p.steps for p in points])
    mean = np.array([p.evaluation_return for p in points])
    spread = np.array([p.evaluation_std for p in points])
    training = np.array([p.training_return for p in points])
    axes.fill_between(steps, mean - spread, mean + spread, color=POLICY, alpha=0.15, lw=0)
    axes.plot(steps, mean, "o-", ms=3, color=POLICY, label="evaluation, ± std of episodes")
    if np.isfinite(training).any():
        axes.plot(steps, training, color=TRAINING, lw=1, label="training, exploration included")
    best = int(np.argmax(mean))
    axes.plot(steps[best], mean[best], "o", ms=9, mfc="none", color=POLICY, label="kept")
    # by definition of the rewards
    axes.axhline(UNDITHERED[experiment], color=NONE, ls="--", lw=1, label="no dither")
    axes.set_xlabel("steps of all arms")
    axes.set_ylabel(UNITS[experiment])
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    save_full(figure, path)
