"""The curve of a training: ``curve.csv`` and ``curve.png``."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.png import save_full

POLICY, TRAINING, NONE = "#1f5fa8", "#8a8a8a", "#d1701a"
UNITS = {
    "sje": "return [1 − |τ_SJE| / |τ_base|, less penalties]",
    "gte": "return [−error / undithered error, less penalties]",
}
"""What a return is, per experiment."""


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows with the same names as CSV, at once; numbers as they are, NaN as nan."""
    out = io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text_atomic(path, out.getvalue())


def write_curve(path: Path, points: Sequence[Any]) -> None:
    """Write a row per evaluation; see `callbacks.CurvePoint` for the columns."""
    write_rows(path, [dataclasses.asdict(p) for p in points])


def draw_curve(
    path: Path, points: Sequence[Any], *, title: str, experiment: str, undithered: float | None
) -> None:
    """Draw returns over steps; the shade is the spread of the evaluation's episodes.

    Args:
        path: of the PNG.
        points: `callbacks.CurvePoint`.
        title: of the picture.
        experiment: one of `UNITS`.
        undithered: mean return without dither on other episodes, None where it is not known.
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
    if undithered is not None:
        axes.axhline(undithered, color=NONE, ls="--", lw=1, label="no dither")
    axes.set_xlabel("steps of all arms")
    axes.set_ylabel(UNITS[experiment])
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    save_full(figure, path)
