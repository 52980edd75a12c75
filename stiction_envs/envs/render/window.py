"""A window with MuJoCo's viewer."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, one_line

# a panel covers part of the scene: camera's distance over the usual one, and its shift to the side
# over the distance [-]; assumed
_FARTHER, _ASIDE = 1.3, 0.2


def has_display() -> bool:
    """Return whether a window can be opened, as far as the environment variables tell."""
    found = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(found) or not sys.platform.startswith("linux")


def check_display(what: str, instead: str) -> None:
    """Raise a StictionError where no window can be opened.

    Args:
        what: name of what needs it.
        instead: advice what to use without one.
    """
    if not has_display():
        raise StictionError(f"{what}: no display found: {instead}")
    if not _opens():
        raise StictionError(f"{what}: the display cannot be opened: {instead}")


def _opens() -> bool:
    """Return whether the display can be opened; if it cannot, the viewer would end the process."""
    if not sys.platform.startswith("linux"):
        return True
    try:
        import glfw

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # our own error says it
            return bool(glfw.init())
    except Exception:  # not installed, or without its library
        return False


def open_viewer(
    what: str,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    key_callback: Callable[[int], None] | None = None,
) -> mujoco.viewer.Handle:
    """Return MuJoCo's viewer of a model, in a thread of its own.

    Args:
        what: name of what needs it, for the error.
        model: what is shown.
        data: its state; the viewer's ``sync`` shows it.
        key_callback: called with the GLFW code of every key that is pressed, in that thread.

    Raises:
        StictionError: it cannot be opened.
    """
    try:
        import mujoco.viewer

        return mujoco.viewer.launch_passive(
            model, data, key_callback=key_callback, show_left_ui=False, show_right_ui=False
        )
    except Exception as error:  # glfw, OpenGL and macOS each fail in their own way
        raise StictionError(f"{what}: no window: {one_line(error)}") from None


class Window:
    """MuJoCo's viewer with a panel over the left of its scene."""

    def __init__(
        self,
        what: str,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: mujoco.MjvCamera,
        key_callback: Callable[[int], None] | None = None,
    ) -> None:
        """Open it; it looks as ``camera`` does, with room for the panel.

        The other arguments and errors are those of `open_viewer`.
        """
        before = set(threading.enumerate())
        self.viewer = open_viewer(what, model, data, key_callback)
        self._threads = [t for t in threading.enumerate() if t not in before]
        heading = np.deg2rad(camera.azimuth)
        right = np.array([np.sin(heading), -np.cos(heading), 0.0])
        distance = _FARTHER * camera.distance
        with self.viewer.lock():
            look = self.viewer.cam
            look.lookat[:] = camera.lookat - _ASIDE * distance * right
            look.distance = distance
            look.azimuth, look.elevation = camera.azimuth, camera.elevation

    def show(self, panel: NDArray[np.uint8], text: str, *, bottom: int = 8) -> None:
        """Show the scene as it is now, a panel (height, width, 3), and a text below.

        Args:
            panel: what is drawn over the scene.
            text: must not be empty.
            bottom: height of the panel's lower edge [pixel].
        """
        # MuJoCo 4.0 draws an image over a textured scene only where a text was drawn before it
        self.viewer.set_texts((None, mujoco.mjtGridPos.mjGRID_BOTTOMLEFT, text, ""))
        height, width = panel.shape[:2]
        self.viewer.set_images((mujoco.MjrRect(8, bottom, width, height), panel))
        self.viewer.sync()

    def close(self) -> None:
        """Close it."""
        self.viewer.close()
        for thread in self._threads:
            thread.join(timeout=5.0)  # an open window crashes the interpreter at its end
