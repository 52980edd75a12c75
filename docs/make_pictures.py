"""Make the pictures of the site: `python docs/make_pictures.py [sje panda log policies so101]`.

The first picture of each way in is what the commands of its page wrote.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import run_page
from matplotlib.figure import Figure

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.reporting.png import save_full

HERE = Path(__file__).parent


def draw_sje() -> None:
    """Draw one experiment with and without dither."""
    experiment = SingleJointExperiment("panda", scatter=False)
    c = Configuration(7, "load", "+")
    jobs = [Job(c), Job(c, 15.0, 0.801)]
    found = {m.job: m for m in experiment.run(jobs, iterations=1)}
    base, dithered = (found[job] for job in jobs)
    threshold, ramp_rate = experiment.protocol.threshold, experiment.protocol.ramp_rate
    figure = Figure(figsize=(8.6, 4.6), layout="constrained")
    axes = figure.subplots()
    name = f"dither {plots.dither_text(dithered.job)}"
    for m, other, colour, text in (
        (base, dithered, plots.WITHOUT, "no dither"),
        (dithered, base, plots.WITH, name),
    ):
        for k, (torque, angle) in enumerate(plots.ramps(m, ramp_rate)):
            moved = c.sign * (angle - m.start[k])
            axes.plot(torque, moved, color=colour, lw=1.0, alpha=0.45, zorder=2)
            axes.plot(torque[-1], moved[-1], "o", color=colour, ms=4, zorder=3)
        axes.axvline(abs(m.mean), color=colour, lw=1.4, ls=(0, (4, 3)), zorder=1)
        left = abs(m.mean) < abs(other.mean)
        axes.annotate(
            f"{text}\n|τ| = {abs(m.mean):.3f} N·m",
            (abs(m.mean), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-6 if left else 6, -2),
            textcoords="offset points",
            ha="right" if left else "left",
            va="top",
            color=colour,
            fontsize=10,
        )
    axes.axhline(threshold, color="0.35", lw=0.9, ls=(0, (1, 2)), zorder=1)
    axes.annotate(
        f"threshold {threshold:g} rad",
        (0.01, threshold),
        xycoords=("axes fraction", "data"),
        xytext=(0, -4),
        textcoords="offset points",
        va="top",
        fontsize=9,
        color="0.35",
    )
    change = 100 * (abs(dithered.mean) / abs(base.mean) - 1)
    level = 0.55 * threshold
    axes.annotate(
        "",
        (abs(dithered.mean), level),
        (abs(base.mean), level),
        arrowprops={"arrowstyle": "-|>", "color": "0.15", "lw": 1.6, "shrinkA": 0, "shrinkB": 0},
    )
    axes.annotate(
        f"{change:+.0f} %".replace("-", "−"),
        ((abs(dithered.mean) + abs(base.mean)) / 2, level),
        xytext=(0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=13,
        fontweight="bold",
        color="0.15",
    )
    axes.set_xlabel("commanded torque, dither excluded [N·m]")
    axes.set_ylabel("joint displacement [rad]")
    axes.set_title(
        "Panda, joint 7, load pose, direction +: torque that moves the joint", fontsize=12
    )
    axes.set_ylim(top=1.4 * threshold)
    plots.plain_axes(axes)
    axes.set_xlim(right=1.22 * max(abs(base.mean), abs(dithered.mean)))
    save_full(figure, HERE / "sje.png")


def run(page: str) -> None:
    """Run a page's commands and keep its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        script = [sys.executable, HERE / "run_page.py", HERE / f"{page}.md", folder]
        done = subprocess.run(script, env={"MUJOCO_GL": "egl", **os.environ}, check=False)
        for name, source in run_page.PICTURES[page].items():
            shutil.copyfile(Path(folder) / source, HERE / name)
    if done.returncode:
        sys.exit(f"{page}.md does not show what its commands print")


if __name__ == "__main__":
    makers: dict[str, Callable[[], None]] = {"sje": draw_sje}
    makers |= {page: lambda page=page: run(page) for page in run_page.PICTURES}
    for wanted in sys.argv[1:] or makers:
        makers[wanted]()
