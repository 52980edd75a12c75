"""MuJoCo's viewer with a sticking arm: keys push a joint and switch its dither."""

from __future__ import annotations

import sys
from collections.abc import Callable

import mujoco

from stiction_envs.envs.render.push_view import KEYS, PushView
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError


class PushWindow:
    """The viewer's window; it runs in real time if the machine is fast enough."""

    def __init__(self, view: PushView) -> None:
        """Open it.

        Raises:
            StictionError: no display, or on a Mac outside of mjpython.
        """
        what, push = "view", view.push
        robot = push.plant.sticking.arm.name
        film = f"stiction sje {robot} --joint {push.joint} --dither TABLE.csv --video"
        page = "`--browser` shows a page (pip install 'stiction-envs[web]')"
        check_display(what, f"`{film}` writes an mp4 without one; {page}")
        if sys.platform == "darwin" and not _in_mjpython():
            raise StictionError(f"{what}: on a Mac: expected `mjpython $(which stiction) view …`")
        self.view = view
        # the viewer calls back in its own thread
        self._window = Window(what, view.model, view.data, view.camera, view.keys.put)
        self._viewer = self._window.viewer
        self._flags = self._viewer.opt.flags.copy(), self._viewer.opt.geomgroup.copy()

    def run(self, report: Callable[[str], None]) -> None:
        """Show the arm until the window is closed; ``report`` is called with changes of state."""
        self.view.run(self._draw, report, is_open=self._viewer.is_running)

    def _draw(self) -> None:
        with self._viewer.lock():
            self.view.draw(self._viewer.user_scn)
            # the viewer has uses of its own for our keys: undo what they switched
            self._viewer.opt.flags[:], self._viewer.opt.geomgroup[:] = self._flags
        texts = (None, mujoco.mjtGridPos.mjGRID_BOTTOMLEFT, KEYS, "")
        self._window.show(self.view.panel(), texts, bottom=60)

    def close(self) -> None:
        """Close the window."""
        self._window.close()


def _in_mjpython() -> bool:
    import mujoco.viewer

    return getattr(mujoco.viewer, "_MJPYTHON", None) is not None
