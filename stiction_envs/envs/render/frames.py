"""Frames of the environments: the arm in its scene, and what the experiment asks of the arm.

The graphics context is made at the first frame; without OpenGL only rendering fails.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Generic, TypeVar

import mujoco
import numpy as np

from stiction_envs.envs.render.arm_scene import (
    ARROW,
    MARK,
    PATH,
    SPHERE,
    ArmScene,
    Frame,
    draw_joint,
    draw_shape,
    polyline,
)
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.episodes import Episodes
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm

if TYPE_CHECKING:
    from stiction_envs.experiments.gte.episodes import GTEEpisodes
    from stiction_envs.experiments.sje.episodes import SJEEpisodes

RENDER_MODES = ("human", "rgb_array")
SIZE = 480  # width and height of a frame [pixel], Gymnasium's default
_AXES = np.insert(np.eye(3, dtype=np.float32), 3, 1.0, axis=1)  # red, green, blue
# what follows is assumed: chosen by eye
_LINE, _GOAL, _AXIS = 0.003, 0.009, 0.12  # radius of lines and goals, length of an axis [m]
_NEARER = 0.8  # camera's distance over that for any pose [-]: the arm keeps its shape

Core = TypeVar("Core", bound=Episodes)


def check_render_mode(mode: str | None, *, batch: bool = False) -> None:
    """Raise a StictionError for a mode that does not exist, or not for a batch."""
    expected = [m for m in RENDER_MODES if not (batch and m == "human")]
    if mode is not None and mode not in expected:
        raise unknown("render mode", mode, expected)


class Renderer(ABC, Generic[Core]):
    """Draws episodes of one experiment; made lazily, closed by its owner."""

    def __init__(self, arm: Arm) -> None:
        """Prepare the scene; OpenGL is not touched yet."""
        self.scene = ArmScene(arm, SIZE, SIZE)
        self._window: Window | None = None
        self._shown = 0.0

    def frame(self, core: Core, i: int, mode: str) -> Frame | None:
        """Return the frame of episode ``i`` of ``core``; in human mode show it and return None."""
        self.scene.pose(core.rig.plant.position[i])
        if mode == "human":
            self._show(core, i)
            return None
        return self.scene.picture(self.camera(core, i), lambda scene: self.draw(scene, core, i))

    @abstractmethod
    def draw(self, scene: mujoco.MjvScene, core: Core, i: int) -> None:
        """Draw marks of episode ``i`` into the scene; the arm is posed."""

    def camera(self, core: Core, i: int) -> mujoco.MjvCamera:
        """Return a camera that sees the arm and the marks of episode ``i``."""
        return self.scene.camera()

    def _show(self, core: Core, i: int) -> None:
        """Show episode ``i`` in the window, a control interval after the frame before."""
        if self._window is None:
            check_display(what := "render_mode human", "use rgb_array")
            model, data = self.scene.model, self.scene.data
            self._window = Window(what, model, data, self.camera(core, i))
        viewer = self._window.viewer
        if not viewer.is_running():
            raise StictionError("the window was closed")
        with viewer.lock():
            viewer.user_scn.ngeom = 0
            self.draw(viewer.user_scn, core, i)
        viewer.sync()
        # real time, if the machine is fast enough
        time.sleep(max(0.0, self._shown + core.interval - time.monotonic()))
        self._shown = time.monotonic()

    def close(self) -> None:
        """Free the graphics context and close the window."""
        self.scene.close()
        if self._window is not None:
            self._window.close()
            self._window = None


class JointRenderer(Renderer["SJEEpisodes"]):
    """Draws the SJE: the joint under test, its angle and the threshold of breakaway."""

    def draw(self, scene: mujoco.MjvScene, core: SJEEpisodes, i: int) -> None:
        """Draw the joint under test."""
        angle, c = float(core.rig.displacement()[i]), core.configuration[i]
        draw_joint(scene, self.scene, c.joint - 1, angle, c.sign * core.rig.protocol.threshold)


class PathRenderer(Renderer["GTEEpisodes"]):
    """Draws the GTE: the path, its goals with the next in orange, the axes of the reference."""

    def camera(self, core: GTEEpisodes, i: int) -> mujoco.MjvCamera:
        """Return a camera that sees the path and the arm at its start, so that it rests."""
        self.scene.pose(core.rig.start)
        camera = self.scene.camera(core.path_points(i))
        self.scene.pose(core.rig.plant.position[i])
        camera.distance *= _NEARER
        return camera

    def draw(self, scene: mujoco.MjvScene, core: GTEEpisodes, i: int) -> None:
        """Draw path, goals and reference."""
        self.scene.draw_chain(scene)
        path, sequencer = core.path_points(i), core.rig.sequencer
        polyline(scene, _LINE, path, PATH)
        for k, goal in enumerate(path[1:]):
            size, colour = (
                (1.6 * _GOAL, MARK) if k == sequencer.arrays.current[i] else (_GOAL, PATH)
            )
            draw_shape(scene, SPHERE, size, goal, colour=colour)
        position, turn, _, _ = sequencer.reference(np.asarray(core.rig.step * CONTROL_DT))
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, turn[i])
        for axis, colour in zip(matrix.reshape(3, 3).T, _AXES, strict=True):
            end = position[i] + _AXIS * axis
            draw_shape(scene, ARROW, 2.0 * _LINE, position[i], end, colour)
