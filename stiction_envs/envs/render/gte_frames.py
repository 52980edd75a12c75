"""Frames of the GTE: the arm, the path through its goals, where it is, its errors and dither."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.control.rotation import to_matrix
from stiction_envs.envs.render.arm_scene import MARK, PATH, ball, connect, polyline
from stiction_envs.envs.render.env_frames import HEIGHT, PANEL_WIDTH, Renderer
from stiction_envs.envs.render.panel import (
    BAND,
    BLUE,
    GRID,
    INK,
    PURPLE,
    SOFT,
    Plot,
    font,
    round_up,
)
from stiction_envs.plant import CONTROL_DT

if TYPE_CHECKING:
    from stiction_envs.experiments.gte.episodes import GTEEpisodes

Array = NDArray[np.float64]
_AXES = np.array(
    [[0.85, 0.15, 0.15, 1.0], [0.1, 0.6, 0.2, 1.0], [0.15, 0.3, 0.9, 1.0]], dtype=np.float32
)
# what follows is assumed: chosen by eye
_TRAIL = 400  # most segments of the tool point's trail
_LINE, _GOAL, _AXIS = 0.0025, 0.009, 0.12  # radius of lines and goals, length of an axis [m]
_NEARER = 0.8  # camera's distance over that for any pose [-]: the arm keeps its shape


class PathRenderer(Renderer):
    """Draws the GTE."""

    _core: GTEEpisodes

    def _words(self, i: int) -> tuple[str, str]:
        trajectory, stiffness = self._core.case[i]
        return "trajectory\nstiffness", f"{trajectory}\n{' '.join(f'{k:g}' for k in stiffness)}"

    def _points(self, i: int) -> Array:
        """Return the points of the arm at its start, so that the camera rests, and the path."""
        arm = self._arm
        q = arm.data.qpos.copy()
        arm.pose(self._core.rig.start)
        points = np.vstack([self._core.path_points(i), super()._points(i)])
        arm.data.qpos[:] = q
        mujoco.mj_forward(arm.model, arm.data)
        return points

    def _camera(self, i: int) -> mujoco.MjvCamera:
        camera = super()._camera(i)
        camera.distance *= _NEARER
        return camera

    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        core, rig = self._core, self._core.rig
        self._arm.draw_chain(scene)
        path, reached = core.path_points(i), int(rig.sequencer.index[i])
        polyline(scene, _LINE, path, PATH)
        for k, goal in enumerate(path[1:]):
            aim = k == reached
            ball(scene, _GOAL * (1.6 if aim else 1.0), goal, MARK if aim else PATH)
        assert core.recorder.trace is not None
        trail = core.recorder.trace[i].position
        if trail:
            points = np.concatenate(trail)
            points = np.vstack([points[:: 1 + len(points) // _TRAIL], rig.end_effector.position[i]])
            polyline(scene, _LINE, points)
        t = np.multiply(rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, _, _ = rig.sequencer.reference(t)
        arrow = mujoco.mjtGeom.mjGEOM_ARROW
        for axis, colour in zip(to_matrix(quaternion[i]).T, _AXES, strict=True):
            connect(scene, arrow, 2.0 * _LINE, x[i], x[i] + _AXIS * axis, colour)

    def _lines(self, i: int) -> tuple[list[str], str]:
        core = self._core
        trajectory, (translational, rotational, nullspace) = core.case[i]
        stiffness = f"stiffness {translational:g} N/m, {rotational:g} N·m/rad"
        stiffness += f", {nullspace:g} N·m/rad" if nullspace else ""
        reached, goals = int(core.rig.sequencer.index[i]), int(core.goals[i])
        seconds = float(core.rig.step[i]) * 1e-3
        state = f"on the way to goal {reached + 1} of {goals}, {seconds:.1f} s"
        if not core.alive[i]:
            ratio = core.tracking_error(np.array([i]))[0]
            state = f"over: error {100 * ratio:.0f} % of undithered"
        elif reached == goals:
            state = f"last goal reached, {seconds:.1f} s"
        return [f"{core.arm.name}  {trajectory}", stiffness], state

    def _plot(self, draw: ImageDraw.ImageDraw, i: int) -> None:
        core, right = self._core, PANEL_WIDTH - 14
        assert core.recorder.trace is not None
        trace = core.recorder.trace[i]
        time = np.concatenate([[0.0], *trace.time])[1:]
        error = np.concatenate([np.zeros((1, 6)), *trace.error])[1:]
        end = round_up(max([core.undithered_duration(i), *time[-1:]]))
        accepted = core.rig.sequencer.accepted_at[i]
        accepted = accepted[np.isfinite(accepted) & (accepted > 0)]
        for top, part, title, least in (
            (94, error[:, :3], "distance from reference [mm]", core.tolerance[0]),
            (222, error[:, 3:], "rotation from reference [mrad]", core.tolerance[1]),
        ):
            size = 1e3 * np.sqrt((part**2).sum(axis=1))
            high = max([1e3 * least, *(1.1 * size)])
            plot = Plot(draw, (58, top, right, top + 96), (0.0, end), (0.0, high), title)
            plot.marks(accepted, PURPLE)
            plot.legend([("new goal", PURPLE)] if top < 200 else [])
            if len(time):
                plot.line(time, size, BLUE)
        plot.time_label()
        self._bars(draw, i, (58, 380, right, HEIGHT - 38))

    def _bars(self, draw: ImageDraw.ImageDraw, i: int, box: tuple[int, int, int, int]) -> None:
        """Draw amplitude (share of A_max) and frequency of every joint's dither."""
        core, (left, top, right, bottom) = self._core, box
        text = "dither: share of A_max, frequency [Hz]"
        draw.text((14, top - 20), text, font=font(12), fill=INK)
        amplitude, frequency = core.action[i, : core.n], core.action[i, core.n : 2 * core.n]
        share = amplitude / core.action_space.high[: core.n]
        pitch = (right - left) / core.n
        draw.rectangle(box, outline=SOFT)
        for j in range(core.n):
            low, high = left + (j + 0.18) * pitch, left + (j + 0.82) * pitch
            middle = 0.5 * (low + high)
            draw.rectangle((low, top + 1, high, bottom - 1), fill=GRID)
            if share[j] > 0:
                edge = bottom - share[j] * (bottom - top - 1)
                draw.rectangle((low, min(edge, bottom - 1), high, bottom - 1), fill=BAND)
                draw.line((low, edge, high, edge), fill=BLUE, width=2)
                place = (middle, bottom + 18)
                draw.text(place, f"{frequency[j]:.0f}", font=font(11), fill=INK, anchor="mt")
            draw.text((middle, bottom + 4), f"J{j + 1}", font=font(11), fill=SOFT, anchor="mt")
