"""Figures 4.2 to 4.5 and Appendices B, C and D: ramps of the Single Joint Experiment.

The thesis has a picture for each joint and pose, iterations above, their mean below; so have we,
both poses of a joint side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import LOADS, Job, Measurement, load_protocol
from stiction_envs.experiments.sje.protocol import configurations as all_configurations
from stiction_envs.measured import DitheredRow, thesis_base, thesis_dithered
from stiction_envs.thesis.items import Found, Item, Needs, Said, Written, say, write_figure
from stiction_envs.thesis.tables import job_of


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
        if self.dither == "none":
            return []
        table, kind = ("4.5", "scale") if self.dither == "base" else ("4.10", "final")
        return [
            r
            for r in thesis_dithered(self.robot)
            if (r.table, r.amplitude_set, r.joint) == (table, kind, self.joint)
        ]

    def jobs(self) -> list[Job]:
        """Return the jobs that are drawn."""
        if self.dither == "none":
            return [Job(c) for c in all_configurations(7, [self.joint])]
        return [job_of(r) for r in self.printed()]

    def needs(self) -> Needs:
        """Return what the figure needs: the base torques too, for the change by dither."""
        base = [Job(c) for c in all_configurations(7, [self.joint])]
        return {"sje": [(self.robot, j) for j in dict.fromkeys([*base, *self.jobs()])]}

    def write(self, item: Item, found: Found, folder: Path) -> Written:
        """Draw the figure."""
        measured = [found["sje"][self.robot, j] for j in self.jobs()]
        base = [found["sje"][self.robot, Job(m.job.configuration)] for m in measured]
        return write_figure(item, folder, draw(measured, self.robot), self.said(measured, base))

    def said(self, measured: Sequence[Measurement], base: Sequence[Measurement]) -> Said:
        """Return what the ramps say.

        Args:
            measured: the four that are drawn.
            base: those without dither, of the same configurations.
        """
        protocol = load_protocol(self.robot)
        good = [k for k, m in enumerate(measured) if np.isfinite(m.mean)]
        taus = [measured[k] for k in good]
        first, scatter = _first_and_others([m.tau for m in taus])
        start, start_scatter = _first_and_others([m.start for m in taus])
        table = thesis_base(self.robot)
        printed = {(r.joint, r.load, r.direction): r for r in self.printed()}
        off, simulated, change = [], [], []
        for k in good:
            c = measured[k].job.configuration
            if self.dither == "none":
                off.append(
                    100 * abs(measured[k].mean / table.get(c.joint, c.load, c.direction) - 1)
                )
            else:
                now = 100 * (abs(measured[k].mean) / abs(base[k].mean) - 1)
                before = printed[c.joint, c.load, c.direction].change_pct
                off.append(abs(now - before))
                simulated.append(now)
                change.append(before)
        return say(
            "ramps",
            dither=self.dither,
            joint=self.joint,
            stuck=len(measured) - len(good),
            iterations=min(len(m.tau) for m in measured),
            off=float(np.mean(off)) if off else float("nan"),
            simulated=float(np.mean(simulated)) if simulated else float("nan"),
            change=float(np.mean(change)) if change else float("nan"),
            first=1e3 * first,
            scatter=1e3 * scatter,
            start=1e3 * start,
            start_scatter=1e3 * start_scatter,
            shaking=1e3 * max((m.displacement for m in taus), default=float("nan")),
            threshold=protocol.threshold,
        )


def _first_and_others(values: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Return how far first iterations are from the others, and how far those scatter (means)."""
    enough = [v for v in values if len(v) > 2]
    if not enough:
        return float("nan"), float("nan")
    away = [abs(float(v[0] - v[1:].mean())) for v in enough]
    return float(np.mean(away)), float(np.mean([v[1:].std(ddof=1) for v in enough]))


def draw(measured: Sequence[Measurement], robot: str) -> Figure:
    """Return the figure: the load pose at the left, the other at the right."""
    protocol = load_protocol(robot)
    figure = Figure(figsize=(13.2, 6.4), layout="constrained")
    parts: Any = figure.subfigures(1, 2, wspace=0.02)
    for part, load in zip(parts, LOADS, strict=True):
        mine = [m for m in measured if m.job.configuration.load == load]
        plots.draw_sje(part, mine, threshold=protocol.threshold, ramp_rate=protocol.ramp_rate)
        kinds = dict.fromkeys(plots.dither_text(m.job) for m in plots.in_direction(mine))
        letter = "ab"[LOADS.index(load)]
        part.suptitle(f"({letter}) {plots.POSES[load]}: {' / '.join(kinds)}", fontsize=12)
    return figure


def ramp_item(id_: str, title: str, ramps: Ramps) -> Item:
    """Return the item of a figure of ramps."""
    return Item(id=id_, kind="figure", title=title, needs=ramps.needs, write=ramps.write)
