"""The Single Joint Experiment as a film: one ramp without dither, next to it one with.

The film shows what was measured: angles and torques are those of a `Measurement`'s iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.film import HEADER, WIDTH, Film
from stiction_envs.envs.render.panel import (
    BLUE,
    GRID,
    INK,
    ORANGE,
    SLIPPING,
    SOFT,
    Colour,
    Plot,
    font,
    signed,
)
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.plots import dither_text, ramps
from stiction_envs.experiments.sje.protocol import Measurement
from stiction_envs.experiments.sje.results import is_base

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """One iteration of a measurement, ready to be drawn."""

    title: str
    time: Array
    """(K,) since the ramp started [s]."""
    torque: Array
    """(K,) commanded, dither excluded [N·m]."""
    angle: Array
    """(K,) of the joint since the ramp started [rad]."""
    tau: float
    """Torque at which it broke away [N·m]; NaN if it was stuck."""

    @classmethod
    def of(cls, m: Measurement, ramp_rate: float, iteration: int = 0) -> Ramp:
        """Return an iteration of a measurement."""
        along, angle = ramps(m, ramp_rate)[iteration]
        text = dither_text(m.job)
        return cls(
            title="no dither" if text == "no dither" else f"dither {text}",
            time=np.arange(1.0, len(along) + 1) * m.trace_dt,
            torque=m.job.configuration.sign * along,
            angle=angle - m.start[iteration],
            tau=float(m.tau[iteration]),
        )


def shown(measurements: Sequence[Measurement]) -> list[Measurement]:
    """Return those of the first configuration with dither, base first; else the first one."""
    dithered = [m for m in measurements if not is_base(m)]
    c = (dithered or list(measurements))[0].job.configuration
    return sorted((m for m in measurements if m.job.configuration == c), key=is_base, reverse=True)


class RampFilm(Film):
    """One configuration; a column for each measurement of it."""

    SCENE, PLOTS, STATE = 300, 218, (5, 24, 36)
    LONGEST = 15.0

    def __init__(
        self,
        experiment: SingleJointExperiment,
        measurements: Sequence[Measurement],
        *,
        fps: float = 10.0,
    ) -> None:
        """Prepare the frames; OpenGL is not touched yet.

        Args:
            experiment: that measured.
            measurements: of one configuration, the first without dither.
            fps: as of `Film`.

        Raises:
            StictionError: measurements of different configurations.
        """
        c = measurements[0].job.configuration
        if any(m.job.configuration != c for m in measurements):
            raise StictionError("a film of different configurations: expected measurements of one")
        arm, protocol = experiment.sticking.arm, experiment.protocol
        self._joint, load, _ = c.index
        self._pose = experiment.poses.q[self._joint, load]
        self._limit = c.sign * protocol.threshold
        self._ramps = [Ramp.of(m, protocol.ramp_rate) for m in measurements]
        heading = f"{arm.title}, joint {c.joint}"
        columns = [(r.title, r.time) for r in self._ramps]
        super().__init__(arm, heading, columns, fps=fps)

    def _prepare(self, scene: ArmScene) -> mujoco.MjvCamera:
        scene.pose(self._pose)
        self._dial = Dial(scene, self._joint)
        return self._dial.camera

    def _joints(self, i: int, k: int, t: float) -> Array:
        q = self._pose.copy()
        q[self._joint] += self._ramps[i].angle[k]
        return q

    def _decorate(self, scene: ArmScene, drawn: mujoco.MjvScene, i: int, k: int) -> None:
        scene.draw_chain(drawn)
        self._dial.draw(drawn, float(self._ramps[i].angle[k]), self._limit)

    def _state(self, i: int, k: int, t: float) -> tuple[str, Colour]:
        r = self._ramps[i]
        if t >= r.time[-1]:
            return ("broke away", ORANGE) if np.isfinite(r.tau) else ("stuck", BLUE)
        slips = abs(r.angle[k]) > SLIPPING * abs(self._limit)
        return ("slips", ORANGE) if slips else ("holds", BLUE)

    def _plot(self, draw: ImageDraw.ImageDraw, i: int, k: int, t: float) -> None:
        r = self._ramps[i]
        self._torque_bar(draw, r, k, bool(t >= r.time[-1]))
        angles = [a for x in self._ramps for a in (x.angle.min(), x.angle.max())]
        edges = [-0.1 * self._limit, 1.3 * self._limit, *angles]
        top = HEADER + self.SCENE + 78
        box = (58, top, WIDTH - 14, self.size[1] - 40)
        limits = (min(edges), max(edges))
        plot = Plot(draw, box, (0.0, 1.02 * self._end), limits, "angle since start [rad]")
        plot.level(self._limit, SOFT, f"broken away: {abs(self._limit):g} rad")
        if k:
            plot.line(r.time[: k + 1], r.angle[: k + 1], ORANGE)
        plot.time_label()

    def _torque_bar(self, draw: ImageDraw.ImageDraw, r: Ramp, k: int, over: bool) -> None:
        """Draw torque now, and where this joint breaks away once it has."""
        top, left, right = HEADER + self.SCENE + 30, 14, WIDTH - 14
        full = 1.12 * max(float(np.abs(x.torque).max()) for x in self._ramps)
        now, colour = float(r.torque[k]), ORANGE if over else BLUE
        text = f"torque {signed(now)} N·m"
        if over and np.isfinite(r.tau):
            now, base = r.tau, self._ramps[0].tau
            text = f"broke away at {signed(now)} N·m"
            if r is not self._ramps[0] and np.isfinite(base):
                text += f"  ({signed(100 * (abs(now) / abs(base) - 1), 0)} %)"
        ink = ORANGE if over else INK
        draw.text((left, top - 23), text, font=font(15, bold=True), fill=ink)
        draw.rectangle((left, top, right, top + 16), fill=GRID)
        end = left + abs(now) / full * (right - left)
        if end > left + 1:
            draw.rectangle((left, top, end, top + 16), fill=colour)
