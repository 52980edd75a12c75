"""A window with MuJoCo's viewer."""

import os
import sys
import threading
import warnings
from collections.abc import Callable, Sequence

import mujoco

from stiction_envs.errors import StictionError, one_line


def has_display() -> bool:
    """Return whether a window can be opened, as far as environment variables show."""
    found = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(found) or not sys.platform.startswith("linux")


def check_display(what: str, instead: str) -> None:
    """Raise a StictionError where no window can be opened for ``what``; it advises ``instead``."""
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


class Window:
    """MuJoCo's viewer with some lines of text."""

    def __init__(
        self,
        what: str,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: mujoco.MjvCamera,
        key_callback: Callable[[int], None] | None = None,
    ) -> None:
        """Open the window for ``what``, in a new thread.

        ``key_callback`` gets the GLFW code of every key that is pressed, in that thread.

        Raises:
            StictionError: it cannot be opened.
        """
        before = set(threading.enumerate())
        try:
            import mujoco.viewer as shown

            self.viewer = shown.launch_passive(
                model, data, key_callback=key_callback, show_left_ui=False, show_right_ui=False
            )
        except Exception as error:  # glfw, OpenGL and macOS each fail in their own way
            raise StictionError(f"{what}: no window: {one_line(error)}") from None
        self._threads = [t for t in threading.enumerate() if t not in before]
        with self.viewer.lock():
            look = self.viewer.cam
            look.lookat[:], look.distance = camera.lookat, camera.distance
            look.azimuth, look.elevation = camera.azimuth, camera.elevation

    def show(self, lines: Sequence[str]) -> None:
        """Show the present scene, and lines of text."""
        self.viewer.set_texts((None, mujoco.mjtGridPos.mjGRID_TOPLEFT, "\n".join(lines), ""))
        self.viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self.viewer.close()
        for thread in self._threads:
            thread.join(timeout=5.0)  # an open window crashes the interpreter at its end
