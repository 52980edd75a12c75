"""The Single Joint Experiment as a film: one ramp without dither, next to it one with.

The film shows what was measured: angles and torques are those of a `Measurement`'s iteration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.panel import (
    BLUE,
    GRID,
    INK,
    ORANGE,
    PAPER,
    SOFT,
    Colour,
    Plot,
    font,
    signed,
)
from stiction_envs.envs.render.scene import ArmScene
from stiction_envs.envs.render.timing import Timing
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.plots import dither_text, ramps
from stiction_envs.experiments.sje.protocol import Measurement
from stiction_envs.experiments.sje.rows import is_base
from stiction_envs.robots.registry import arm_title

Array = NDArray[np.float64]
WIDTH, HEADER, SCENE, BELOW = 480, 62, 300, 218
"""Of a column: its width; heights of title, arm and plots [pixel]."""
_SLIP = 0.1  # part of the threshold that a joint has moved by which slips


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


class RampVideo:
    """Frames of one configuration; a column for each measurement of it."""

    def __init__(
        self,
        experiment: SingleJointExperiment,
        measurements: Sequence[Measurement],
        *,
        fps: float = 10.0,
        most: float = 15.0,
    ) -> None:
        """Prepare the frames; OpenGL is not touched yet.

        Args:
            experiment: that measured.
            measurements: of one configuration, the first without dither.
            fps: frames per second.
            most: length of the film [s]; what takes longer is shown faster.

        Raises:
            StictionError: measurements of different configurations.
        """
        c = measurements[0].job.configuration
        if any(m.job.configuration != c for m in measurements):
            raise StictionError("a film of different configurations: expected measurements of one")
        self._arm, protocol = experiment.sticking.arm, experiment.protocol
        self._joint, load, _ = c.index
        self._pose = experiment.poses.q[self._joint, load]
        self._limit = c.sign * protocol.threshold
        self._ramps = [Ramp.of(m, protocol.ramp_rate) for m in measurements]
        self._heading = f"{arm_title(self._arm.name)}, joint {c.joint}"
        self.timing = Timing(max(r.time[-1] for r in self._ramps), fps=fps, most=most)
        self.size = (WIDTH * len(self._ramps), HEADER + SCENE + BELOW)
        """Width and height of a frame [pixel]."""

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames, (height, width, 3).

        Raises:
            StictionError: no OpenGL.
        """
        scene = ArmScene(self._arm, WIDTH, SCENE)
        try:
            scene.pose(self._pose)
            dial = Dial(scene, self._joint)
            for t in self.timing.times():
                columns = [self._column(scene, dial, r, t) for r in self._ramps]
                yield np.concatenate(columns, axis=1)
        finally:
            scene.close()

    def _column(self, scene: ArmScene, dial: Dial, r: Ramp, t: float) -> NDArray[np.uint8]:
        k = max(0, int(np.searchsorted(r.time, t, side="right")) - 1)
        over = bool(t >= r.time[-1])
        q = self._pose.copy()
        q[self._joint] += r.angle[k]
        scene.pose(q)

        def decorate(drawn: mujoco.MjvScene) -> None:
            scene.draw_chain(drawn, 0.03)
            dial.draw(drawn, float(r.angle[k]), self._limit)

        image = Image.new("RGB", (WIDTH, HEADER + SCENE + BELOW), PAPER)
        image.paste(Image.fromarray(scene.picture(dial.camera, decorate)), (0, HEADER))
        draw = ImageDraw.Draw(image)
        self._header(draw, r, t, k, over)
        self._torque_bar(draw, r, k, over)
        self._angle_plot(draw, r, k)
        return np.array(image, dtype=np.uint8)

    def _header(self, draw: ImageDraw.ImageDraw, r: Ramp, t: float, k: int, over: bool) -> None:
        draw.text((14, 7), r.title, font=font(19, bold=True), fill=INK)
        draw.text((14, 35), self._heading, font=font(14), fill=SOFT)
        state, colour = self._state(r, k, over)
        place = (WIDTH - 14, 5)
        draw.text(place, state, font=font(24, bold=True), fill=colour, anchor="ra")
        clock = f"{min(t, r.time[-1]):.1f} s{self.timing.faster}"
        draw.text((WIDTH - 14, 36), clock, font=font(14), fill=SOFT, anchor="ra")

    def _state(self, r: Ramp, k: int, over: bool) -> tuple[str, Colour]:
        if over:
            return ("broke away", ORANGE) if np.isfinite(r.tau) else ("stuck", BLUE)
        return ("slips", ORANGE) if abs(r.angle[k]) > _SLIP * abs(self._limit) else ("holds", BLUE)

    def _torque_bar(self, draw: ImageDraw.ImageDraw, r: Ramp, k: int, over: bool) -> None:
        """Draw torque now, and where this joint breaks away once it has."""
        top, left, right = HEADER + SCENE + 30, 14, WIDTH - 14
        full = 1.12 * max(float(np.abs(x.torque).max()) for x in self._ramps)
        now = r.tau if over and np.isfinite(r.tau) else float(r.torque[k])
        text = f"torque {signed(now)} N·m"
        if over and np.isfinite(r.tau):
            text = f"broke away at {signed(now)} N·m"
            base = self._ramps[0].tau
            if r is not self._ramps[0] and np.isfinite(base):
                text += f"  ({100 * (abs(now) / abs(base) - 1):+.0f} %)".replace("-", "−")
        draw.text((left, top - 23), text, font=font(15, bold=True), fill=ORANGE if over else INK)
        draw.rectangle((left, top, right, top + 16), fill=GRID)
        end = left + abs(now) / full * (right - left)
        if end > left + 1:
            draw.rectangle((left, top, end, top + 16), fill=ORANGE if over else BLUE)

    def _angle_plot(self, draw: ImageDraw.ImageDraw, r: Ramp, k: int) -> None:
        end = max(float(x.time[-1]) for x in self._ramps)
        angles = [a for x in self._ramps for a in (x.angle.min(), x.angle.max())]
        low = min(-0.1 * self._limit, 1.3 * self._limit, *angles)
        high = max(-0.1 * self._limit, 1.3 * self._limit, *angles)
        bottom = HEADER + SCENE + BELOW - 40
        box = (58, HEADER + SCENE + 78, WIDTH - 14, bottom)
        plot = Plot(draw, box, (0.0, 1.02 * end), (low, high), "angle since start [rad]")
        plot.level(self._limit, SOFT, f"broken away: {abs(self._limit):g} rad")
        if k:
            plot.line(r.time[: k + 1], r.angle[: k + 1], ORANGE)
        plot.time_label()
