"""Frames of the SJE: the arm, a ring about the joint under test, its dither, torque and angle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from PIL import ImageDraw

from stiction_envs.envs.render.arm_scene import connect, polyline
from stiction_envs.envs.render.env_frames import HEIGHT, PANEL_WIDTH, Renderer
from stiction_envs.envs.render.panel import BAND, BLUE, ORANGE, SOFT, Plot, round_up

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.episodes import SJEEpisodes

_RING = 36  # number of segments; assumed


class JointRenderer(Renderer):
    """Draws the SJE."""

    _core: SJEEpisodes

    def _words(self, i: int) -> tuple[str, str]:
        c = self._core.configuration[i]
        return "joint\nload\ndirection", f"{c.joint}\n{c.load}\n{c.direction}"

    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        """Draw a ring about the axis of the joint under test, with an arrow along the ramp."""
        data, joint = self._arm.data, self._arm.joints[self._core.rig.joint[i]]
        centre, axis = data.xanchor[joint], data.xaxis[joint]
        first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        radius = 0.15 * max(0.3, min(1.0, float(np.ptp(self._points(i), axis=0).max())))
        sign = self._core.rig.sign[i]
        turn = sign * np.linspace(0, 1.75 * np.pi, _RING)[:, None]
        ring = centre + radius * (np.cos(turn) * first + np.sin(turn) * second)
        polyline(scene, 0.06 * radius, ring)
        tangent = sign * (np.cos(turn[-1]) * second - np.sin(turn[-1]) * first)
        tip = ring[-1] + 0.45 * radius * tangent
        connect(scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.12 * radius, ring[-1], tip)
        ends = np.array([centre - 1.3 * radius * axis, centre + 1.3 * radius * axis])
        polyline(scene, 0.03 * radius, ends)
        self._arm.draw_chain(scene, 0.3 * radius)

    def _lines(self, i: int) -> tuple[list[str], str]:
        core, c = self._core, self._core.configuration[i]
        assert core.trace is not None
        trace, tau = core.trace[i], float(core.rig.tau[i])
        dither = "no dither on this joint"
        if trace.time and trace.amplitude[-1] != 0:
            dither = f"dither {trace.amplitude[-1]:.2f} N·m at {trace.frequency[-1]:.0f} Hz"
        pose = "load pose" if c.load == "load" else "no-load pose"
        if core.alive[i]:
            seconds = trace.time[-1] if trace.time else 0.0
            state = f"ramp: {seconds:.1f} s, {core.torque(np.array([i]))[0]:+.2f} N·m"
        elif np.isfinite(tau):
            state = f"broke away at {tau:+.2f} N·m (base {float(core.tau_base[i]):+.2f})"
        else:
            state = "given up"
        title = f"{core.arm.name}  joint {c.joint}"
        return [title, f"{pose}, direction {c.direction}", dither], state

    def _plot(self, draw: ImageDraw.ImageDraw, i: int) -> None:
        core, c, right = self._core, self._core.configuration[i], PANEL_WIDTH - 14
        assert core.trace is not None
        trace, base = core.trace[i], float(core.tau_base[i])
        threshold = c.sign * core.rig.protocol.threshold
        time, moved = np.array(trace.time), np.array(trace.displacement)
        torque, size = np.array(trace.torque), np.array(trace.amplitude)
        ramp = abs(base) / core.rig.protocol.ramp_rate
        end = round_up(max([1.2 * ramp, *time[-1:]]))
        edges = [0.0, 1.25 * base, *(torque - size), *(torque + size)]
        limits = min(edges), max(edges)
        top = Plot(draw, (58, 112, right, 254), (0.0, end), limits, "torque [N·m]")
        top.level(base, SOFT, "τ_base")
        if len(time):
            top.band(time, torque - size, torque + size, BAND)
            top.line(time, torque, BLUE)
        top.legend([("with dither", BAND), ("without", BLUE)])
        edges = [-0.02, 0.02, 1.2 * threshold, *moved]
        limits, below = (min(edges), max(edges)), (58, 296, right, HEIGHT - 42)
        bottom = Plot(draw, below, (0.0, end), limits, "angle since start [rad]")
        bottom.level(threshold, SOFT, "threshold")
        if len(time):
            bottom.line(time, moved, ORANGE)
        bottom.time_label()
