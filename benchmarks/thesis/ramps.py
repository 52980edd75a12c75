"""Ramps of the Single Joint Experiment: Figures 4.2 to 4.5 and Appendices B, C and D.

The thesis has a picture for each joint and pose, ours has both poses of a joint side by side.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.thesis.items import Found, Needs, Picture
from benchmarks.thesis.torques import base_jobs, cells_of, job_of
from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import LOADS, Job, Measurement, load_protocol
from stiction_envs.measured.thesis_tables import DitheredRow, thesis_base
from stiction_envs.reporting.markdown import number, percent
from tuning.protocol.stages import change


@dataclass(frozen=True)
class Ramps:
    """One joint of one arm, with one kind of dither."""

    robot: str
    joint: int
    """From 1."""
    dither: str
    """``none``, ``base`` (Table 4.5) or ``final`` (Table 4.10)."""

    def printed(self) -> list[DitheredRow]:
        """Return the printed cells of the dithered ramps, in the order of the configurations."""
        table, kind = ("4.5", "scale") if self.dither == "base" else ("4.10", "final")
        return [r for r in cells_of(table) if (r.amplitude_set, r.joint) == (kind, self.joint)]

    def jobs(self) -> list[Job]:
        """Return the jobs that are drawn."""
        if self.dither == "none":
            return base_jobs([self.joint])
        return [job_of(r) for r in self.printed()]

    def needs(self) -> Needs:
        """Return what the figure needs: the base torques too, for the change by dither."""
        jobs = dict.fromkeys([*base_jobs([self.joint]), *self.jobs()])
        return {"sje": [(self.robot, j) for j in jobs]}

    def picture(self, found: Found) -> Picture:
        """Return the figure: the load pose at the left, the other at the right."""
        measured = [found["sje"][self.robot, j] for j in self.jobs()]
        base = [found["sje"][self.robot, Job(m.job.configuration)] for m in measured]
        protocol = load_protocol(self.robot)
        figure = Figure(figsize=(13.2, 6.4), layout="constrained")
        parts: Any = figure.subfigures(1, 2, wspace=0.02)
        for part, load, letter in zip(parts, LOADS, "ab", strict=True):
            mine = [m for m in measured if m.job.configuration.load == load]
            plots.draw_sje(part, mine, protocol)
            kinds = dict.fromkeys(plots.dither_text(m.job) for m in plots.in_direction(mine))
            part.suptitle(f"({letter}) {plots.POSES[load]}: {' / '.join(kinds)}", fontsize=12)
        return Picture(figure, self.compare(measured, base))

    def compare(self, measured: Sequence[Measurement], base: Sequence[Measurement]) -> str:
        """Return how the four ramps that are drawn compare with print.

        Args:
            measured: the four.
            base: those without dither, of the same configurations.
        """
        good = [k for k, m in enumerate(measured) if np.isfinite(m.mean)]
        stuck = "" if len(good) == len(measured) else f"; {len(measured) - len(good)} never moved"
        if self.dither == "none":
            table, jobs = thesis_base(self.robot), [m.job.configuration for m in measured]
            printed = [table.tau[c.index] for c in jobs]
            off = [100 * abs(measured[k].mean / printed[k] - 1) for k in good] or [math.nan]
            return f"{number(float(np.mean(off)))} % off (calibrated){stuck}"
        now = np.array([change(measured[k], base[k]) for k in good] or [np.nan])
        before = np.array([self.printed()[k].change_pct for k in good] or [np.nan])
        apart = number(np.abs(now - before).mean())
        means = f"{percent(now.mean())} (print {percent(before.mean())})"
        return f"{means}, one by one {apart} points apart{stuck}"
