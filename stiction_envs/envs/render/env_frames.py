"""Frames of the environments: the arm in a scene, a panel of plots next to it.

What is drawn into them is in `sje_frames.py` and `gte_frames.py`. The graphics context is made at
the first frame; without OpenGL only rendering fails.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.panel import draw_panel
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError, unknown

if TYPE_CHECKING:
    from stiction_envs.experiments.episodes import Episodes

Array = NDArray[np.float64]
Frame = NDArray[np.uint8] | NDArray[np.float32]
"""A picture (height, width, 3), or distances (height, width) [m]."""
RENDER_MODES = ("human", "rgb_array", "depth_array")
SCENE_WIDTH, HEIGHT, PANEL_WIDTH = 460, 450, 340
"""Size of the scene and of the panel next to it [pixel]."""


def check_render_mode(mode: str | None, *, batch: bool = False) -> None:
    """Raise a StictionError for a mode that does not exist, or not for a batch."""
    expected = [m for m in RENDER_MODES if not (batch and m == "human")]
    if mode is not None and mode not in expected:
        raise unknown("render mode", mode, expected)


class Renderer(ABC):
    """Draws the simulations of one environment; made lazily, closed by the environment."""

    def __init__(self, core: Episodes) -> None:
        """Prepare the scene; OpenGL is not touched yet."""
        self._core = core
        self._arm = ArmScene(core.arm, SCENE_WIDTH, HEIGHT)
        self._window: Window | None = None
        self._shown = 0.0

    def frame(self, i: int, mode: str) -> Frame | None:
        """Return the frame of simulation ``i``; in human mode show it and return None."""
        self._arm.pose(self._core.rig.plant.position[i])
        if mode == "human":
            self._show(i)
            return None
        camera = self._camera(i)
        if mode == "depth_array":
            return self._arm.depth(camera)
        picture = self._arm.picture(camera, lambda scene: self._decorate(scene, i))
        return np.concatenate([picture, self._panel(i)], axis=1)

    @abstractmethod
    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        """Draw markers of the experiment into the scene."""

    @abstractmethod
    def _lines(self, i: int) -> tuple[list[str], str]:
        """Return the lines above the plots of simulation ``i``, and its state."""

    @abstractmethod
    def _plot(self, draw: ImageDraw.ImageDraw, i: int) -> None:
        """Draw the plots of simulation ``i``."""

    @abstractmethod
    def _words(self, i: int) -> tuple[str, str]:
        """Return names and values that describe simulation ``i``, each in lines."""

    def _panel(self, i: int) -> NDArray[np.uint8]:
        return draw_panel(PANEL_WIDTH, HEIGHT, *self._lines(i), lambda draw: self._plot(draw, i))

    def _points(self, i: int) -> Array:
        """Return (K, 3) points [m] that must be in the frame."""
        return self._arm.points

    def _camera(self, i: int) -> mujoco.MjvCamera:
        return self._arm.camera(self._points(i))

    def _show(self, i: int) -> None:
        if self._window is None:
            what = "render_mode human"
            check_display(what, "use rgb_array or depth_array")
            self._window = Window(what, self._arm.model, self._arm.data, self._camera(i))
        viewer = self._window.viewer
        if not viewer.is_running():
            raise StictionError("the window was closed")
        with viewer.lock():
            viewer.user_scn.ngeom = 0
            self._decorate(viewer.user_scn, i)
        self._window.show(self._panel(i), (None, None, *self._words(i)))
        # in real time if the machine is fast enough
        late = time.monotonic() - self._shown
        time.sleep(max(0.0, self._core.interval - late))
        self._shown = time.monotonic()

    def close(self) -> None:
        """Free the graphics context and close the window."""
        self._arm.close()
        if self._window is not None:
            self._window.close()
            self._window = None
