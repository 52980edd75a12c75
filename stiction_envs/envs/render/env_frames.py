"""Frames of the environments, and of the commands' videos: the arm in a scene, plots next to it.

What is drawn into them is in `sje_frames.py` and `gte_frames.py`. The graphics context is made at
the first frame; without OpenGL only rendering fails.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Any, Generic, Protocol, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.arrays import Array
from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.panel import draw_panel
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError, unknown
from stiction_envs.robots import Arm

Frame = NDArray[np.uint8]
"""A picture (height, width, 3)."""
RENDER_MODES = ("human", "rgb_array")
SCENE_WIDTH, HEIGHT, PANEL_WIDTH = 460, 450, 340
"""Size of the scene and of the panel next to it [pixel]."""
WIDTH = SCENE_WIDTH + PANEL_WIDTH


class Moment(Protocol):
    """A moment of a run."""

    @property
    def position(self) -> Array:
        """(n,) joint angles [rad]."""


Shown = TypeVar("Shown", bound=Moment)


def check_render_mode(mode: str | None, *, batch: bool = False) -> None:
    """Raise a StictionError for a mode that does not exist, or not for a batch."""
    expected = [m for m in RENDER_MODES if not (batch and m == "human")]
    if mode is not None and mode not in expected:
        raise unknown("render mode", mode, expected)


class Renderer(ABC, Generic[Shown]):
    """Draws runs of one experiment; made lazily, closed by its owner."""

    def __init__(self, arm: Arm) -> None:
        """Prepare the scene; OpenGL is not touched yet."""
        self._arm = ArmScene(arm, SCENE_WIDTH, HEIGHT)
        self._window: Window | None = None
        self._shown = 0.0

    def frame(self, core: Any, i: int, mode: str) -> Frame | None:
        """Return the frame of episode ``i`` of ``core``; in human mode show it and return None."""
        state = self.state(core, i)
        if mode == "rgb_array":
            return self.picture(state)
        self._arm.pose(state.position)
        self._show(state, core.interval)
        return None

    def picture(self, state: Shown) -> NDArray[np.uint8]:
        """Return a picture (HEIGHT, WIDTH, 3)."""
        self._arm.pose(state.position)
        camera = self._camera(state)
        scene = self._arm.picture(camera, lambda scene: self._decorate(scene, state))
        lines = self._lines(state)
        panel = draw_panel(PANEL_WIDTH, HEIGHT, lines, lambda draw: self._plot(draw, state))
        return np.concatenate([scene, panel], axis=1)

    @staticmethod
    @abstractmethod
    def state(core: Any, i: int) -> Shown:
        """Return the present moment of episode ``i`` of the experiment's `Episodes`."""

    @abstractmethod
    def _decorate(self, scene: mujoco.MjvScene, state: Shown) -> None:
        """Draw markers of the experiment into the scene; the arm is posed."""

    @abstractmethod
    def _lines(self, state: Shown) -> list[str]:
        """Return the lines above the plots: a title, the run, and its state."""

    @abstractmethod
    def _plot(self, draw: ImageDraw.ImageDraw, state: Shown) -> None:
        """Draw the plots."""

    def _camera(self, state: Shown) -> mujoco.MjvCamera:
        return self._arm.camera(self._arm.points)

    def _show(self, state: Shown, interval: float) -> None:
        """Show a state in the window, ``interval`` [s] after the one before."""
        if self._window is None:
            what = "render_mode human"
            check_display(what, "use rgb_array")
            self._window = Window(what, self._arm.model, self._arm.data, self._camera(state))
        viewer = self._window.viewer
        if not viewer.is_running():
            raise StictionError("the window was closed")
        with viewer.lock():
            viewer.user_scn.ngeom = 0
            self._decorate(viewer.user_scn, state)
        self._window.show(self._lines(state))
        # in real time if the machine is fast enough
        late = time.monotonic() - self._shown
        time.sleep(max(0.0, interval - late))
        self._shown = time.monotonic()

    def close(self) -> None:
        """Free the graphics context and close the window."""
        self._arm.close()
        if self._window is not None:
            self._window.close()
            self._window = None
