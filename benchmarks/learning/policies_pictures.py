"""Pictures of `policies`: learning curves, error against vibration, what the best policy does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from benchmarks.learning.policies_plan import (
    BASELINES,
    BOUND,
    RANDOM_PATHS,
    TRAINED,
    environment,
    learned,
    title,
)
from benchmarks.learning.policies_results import AIM, ERRORS, MEASURES, VIBRATIONS, Results
from benchmarks.learning.policies_run import Trained
from benchmarks.learning.policies_statistics import LEVEL
from stiction_envs.reporting.markdown import plural
from stiction_envs.reporting.png import save_full
from tuning.policies.distil import watch
from tuning.policies.settings import policy_settings

LOOKS = {
    "none": ("o", "0.4"),
    BOUND: ("1", "0.2"),
    "random": ("x", "0.6"),
    "Table 4.9": ("s", "#d1701a"),
    "make tune": ("D", "#b8860b"),
    "search, constant": ("^", "#2b7bba"),
    "gated": ("p", "#17a2a2"),
    "search, default gate": ("p", "#17a2a2"),
    "rule": ("*", "#1f3f8a"),
    "feedforward": ("<", "#7a1740"),
    "push": ("X", "#2a5a2a"),
    "SAC": ("P", "#c0285f"),
    "TD3": ("v", "#8c6bb1"),
    "PPO": ("h", "#4a9a4a"),
}
"""Mark and colour of every agent."""
KIND = ("panda", "gte")
"""Robot and experiment whose best policy is drawn."""
WATCHED = range(0, 16, 4)
"""Those of the test's random paths on which the best policy's actions are drawn, two arms each."""
SLOWEST = 1e-4
"""Speeds below are drawn here [rad/s]; assumed."""


def draw_curves(path: Path, results: Results) -> None:
    """Draw returns over steps: mean and spread over seeds."""
    groups: dict[tuple[str, str], dict[str, list[Trained]]] = {}
    for one in results.trained:
        t = one.training
        groups.setdefault((t.robot, t.experiment), {}).setdefault(t.algorithm, []).append(one)
    figure = Figure(figsize=(5.5 * len(groups), 4.5), layout="constrained")
    all_axes: Any = figure.subplots(1, len(groups), squeeze=False)
    for axes, ((robot, experiment), mine) in zip(all_axes[0], groups.items(), strict=True):
        for algorithm, folders in mine.items():
            _draw_curve(axes, algorithm, folders)
        axes.set_title(f"{title(robot)}{experiment.upper()}, spread of seeds shaded")
        axes.set_xlabel("steps of all arms")
        axes.set_ylabel("return of the evaluation [1]")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    save_full(figure, path)


def _draw_curve(axes: Any, algorithm: str, folders: list[Trained]) -> None:
    curves = [one.curve for one in folders]
    steps = curves[0][0]  # of one plan: all evaluate at the same steps
    returns = np.array([r[: len(steps)] for _, r in curves])
    mark, colour = LOOKS[TRAINED[algorithm]]
    label = f"{TRAINED[algorithm]}, {plural(len(folders), 'seed')}"
    axes.plot(steps, returns.mean(axis=0), marker=mark, ms=4, color=colour, label=label)
    low, high = returns.min(axis=0), returns.max(axis=0)
    axes.fill_between(steps, low, high, color=colour, alpha=0.15, lw=0)


def draw_pareto(path: Path, results: Results) -> None:
    """Draw errors left against vibration on the Panda's random paths."""
    cell = results.cell("panda", RANDOM_PATHS)
    measures, base = MEASURES["gte"], BASELINES["panda"]
    figure = Figure(figsize=(12, 9), layout="constrained")
    all_axes: Any = figure.subplots(2, 2, sharey="row", sharex="col")
    for row, error in zip(all_axes, ERRORS, strict=True):
        for axes, vibration in zip(row, VIBRATIONS, strict=True):
            for name in results.by_cell[cell]:
                x, y = (results.estimate(cell, name, key) for key in (vibration, error))
                up, sideways = ([[e.value - e.low], [e.high - e.value]] for e in (y, x))
                mark, colour = LOOKS[name]
                style = {"mec": colour, "mfc": "none", "mew": 2, "ms": 10, "elinewidth": 1}
                axes.errorbar(
                    x.value, y.value, up, sideways, fmt=mark, ecolor=colour, label=name, **style
                )
            axes.grid(alpha=0.3)
            _aim(
                axes,
                results.estimate(cell, base, vibration).value,
                (1 - AIM[error]) * results.estimate(cell, base, error).value,
            )
    for axes, vibration in zip(all_axes[-1], VIBRATIONS, strict=True):
        unit = {"1": "over the undithered run's [1]"}.get(measures[vibration].unit, "rms [mm]")
        axes.set_xlabel(f"{measures[vibration].label}, {unit}")
    for axes, error in zip(all_axes[:, 0], ERRORS, strict=True):
        axes.set_ylabel(f"{error} error left, over the undithered run's [1]")
    handles, labels = all_axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, loc="outside right upper")
    shown = f"interquartile means, {100 * LEVEL:g} % intervals"
    figure.suptitle(f"Panda, {len(cell.options)} random paths; {shown}")
    save_full(figure, path)


def _aim(axes: Any, vibration: float, error: float) -> None:
    """Shade where the aim is met."""
    left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
    axes.fill_between(
        [left, vibration], bottom, error, color="#4a9a4a", alpha=0.12, lw=0, label="aim"
    )
    axes.set_xlim(left=left)
    axes.set_ylim(bottom=bottom)


def draw_behaviour(path: Path, results: Results) -> tuple[str, float]:
    """Draw the best policy's amplitudes over speed and torque.

    Returns:
        Name of its kind, and the largest of all joints' standard deviations of the amplitude over
        the largest that is allowed [-].
    """
    mine = [x for x in results.trained if (x.training.robot, x.training.experiment) == KIND]
    best = max(mine, key=lambda x: float(x.curve[1].max()))
    training = best.training
    first = policy_settings().evaluation.test_paths
    seen = []
    for number in WATCHED:
        fixed = {"path": first + number}
        task = environment(training.robot, training.experiment, fixed_options=fixed)
        env: Any = task.make(2)
        seen.append(np.stack(watch(env, learned(training, best.policy).make(env), seed=0)))
        top = env.single_action_space.high
        env.close()
    speed, torque, amplitude, frequency = np.concatenate(seen, axis=1)
    n = speed.shape[1]
    figure = Figure(figsize=(16, 8), layout="constrained")
    all_axes: Any = figure.subplots(2, (n + 2) // 2, sharex=True, sharey=True)
    shade = Normalize(0, 1)
    for j, axes in enumerate(all_axes.flat):
        if j >= n:
            axes.set_axis_off()
            continue
        points = axes.scatter(
            np.maximum(np.abs(speed[:, j]), SLOWEST),
            np.abs(torque[:, j]),
            c=amplitude[:, j] / top[j],
            norm=shade,
            s=6,
            cmap="viridis",
        )
        power = amplitude[:, j] ** 2 + 1e-12
        mean = float(np.average(frequency[:, j], weights=power))
        axes.set_title(f"joint {j + 1}, mostly {mean:.0f} Hz", fontsize=10)
        axes.set_xscale("log")
        axes.grid(alpha=0.3)
        axes.label_outer()
    for axes in all_axes[:, 0]:
        axes.set_ylabel("torque without dither over stiction, |τ|/F_s [1]")
    for axes in all_axes.flat[n - all_axes.shape[1] : n]:
        axes.set_xlabel("speed |q̇| [rad/s]")
        axes.tick_params(labelbottom=True)
    figure.colorbar(points, ax=all_axes, label="amplitude over the largest [1]")
    name = f"{TRAINED[training.algorithm]}, seed {training.run}"
    figure.suptitle(f"{name} on {title(training.robot)}'s random paths that no training draws")
    save_full(figure, path)
    return TRAINED[training.algorithm], float((amplitude / top[:n]).std(axis=0).max())
