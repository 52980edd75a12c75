"""Report of a training: its curve, its pages, and the means of evaluated policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.friction.assumed import friction_note
from stiction_envs.friction.sticking import friction_of
from stiction_envs.reporting.markdown import number, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.robots import Arm
from stiction_envs.robots.registry import arm_title

if TYPE_CHECKING:
    from tuning.policies.evaluation import Evaluated
    from tuning.policies.task import Task
    from tuning.policies.train import CurvePoint, Trained

TEMPLATE = Path(__file__).parents[1] / "templates" / "train.md.j2"
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
"""Means that the report shows: heading, factor, digits."""


def means_table(
    summary: Mapping[str, Mapping[str, float]],
) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of `Evaluated.summary`, one row per policy."""
    shown = [c for c in COLUMNS if c in next(iter(summary.values()))]
    rows = [
        [policy, *(number(means[c] * COLUMNS[c][1], COLUMNS[c][2]) for c in shown)]
        for policy, means in summary.items()
    ]
    return ["policy", *(COLUMNS[c][0] for c in shown)], rows


def write_report(
    folder: Path,
    task: Task,
    arm: Arm,
    algorithm: str,
    trained: Trained,
    evaluated: Evaluated,
) -> None:
    """Write both pages.

    Args:
        folder: an existing one, with ``curve.png``.
        task: task of the training.
        arm: its arm.
        algorithm: its name.
        trained: the policy's curve.
        evaluated: no dither ("none") and the policy ("trained"), on the same episodes.
    """
    summary = evaluated.summary()
    none, policy = summary["none"], summary["trained"]
    gain, error = policy["return"] - none["return"], policy["return_error"]
    write_md_and_html(
        folder,
        TEMPLATE,
        f"{algorithm.upper()} on {task.name}",
        note=friction_note(arm, friction_of(arm, task.arguments.get("friction"))),
        robot=arm_title(task.arm_name),
        algorithm=f"{algorithm.upper()} on {task.name}",
        trained=policy["return"],
        error=error,
        undithered=none["return"],
        words="" if gain > 2 * error else ": no significant gain over the scatter of episodes",
        first=trained.points[0].evaluation_return,
        best=trained.best.evaluation_return,
        best_steps=trained.best.steps,
        table=table_text(*means_table(summary)),
    )


# ---- the curve -----------------------------------------------------------------------------------

POLICY, NONE = "#1f5fa8", "#d1701a"


def draw_curve(path: Path, points: Sequence[CurvePoint], *, title: str, experiment: str) -> None:
    """Draw returns over steps; the shade is the standard deviation over the evaluation's episodes.

    Args:
        path: path of the PNG.
        points: the evaluations.
        title: title of the plot.
        experiment: one of `envs.registration.EXPERIMENTS`.
    """
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
