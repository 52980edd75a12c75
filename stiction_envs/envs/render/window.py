"""A window with MuJoCo's viewer."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from stiction_envs.errors import StictionError

_FARTHER, _ASIDE = 1.3, 0.2  # of the camera: a panel is drawn over the scene


def has_display() -> bool:
    """Return whether a window can be opened, as far as the environment variables tell."""
    found = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(found) or not sys.platform.startswith("linux")


def check_display(what: str, instead: str) -> None:
    """Raise a StictionError where no window can be opened.

    Args:
        what: needs it.
        instead: works without one.
    """
    if not has_display():
        raise StictionError(f"{what}: no display found: {instead}")
    if not _opens():
        raise StictionError(f"{what}: the display cannot be opened: {instead}")


def _opens() -> bool:
    """Return whether the display is really there: where it is not, the viewer ends the process."""
    if not sys.platform.startswith("linux"):
        return True
    try:
        import glfw

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what we say is enough
            return bool(glfw.init())
    except Exception:  # not installed, or without its library
        return False


def open_viewer(
    what: str,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    key_callback: Callable[[int], None] | None = None,
) -> Any:
    """Return MuJoCo's viewer of a model, in a thread of its own.

    Args:
        what: needs it, for the error.
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


def one_line(error: BaseException) -> str:
    """Return what an error says, or its name, as one line."""
    return " ".join(str(error).split()) or type(error).__name__


def look_beside_panel(viewer: Any, camera: mujoco.MjvCamera) -> None:
    """Let a viewer look as a camera does, with room for a panel on the left."""
    heading = np.deg2rad(camera.azimuth)
    right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    distance = _FARTHER * camera.distance
    with viewer.lock():
        viewer.cam.lookat[:] = camera.lookat - _ASIDE * distance * right
        viewer.cam.distance = distance
        viewer.cam.azimuth, viewer.cam.elevation = camera.azimuth, camera.elevation
