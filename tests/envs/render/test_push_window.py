"""MuJoCo's viewer on an arm that a person pushes."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from stiction_envs.envs.render import window
from stiction_envs.envs.render.push_view import HEIGHT, UP, WIDTH
from stiction_envs.envs.render.push_window import PushWindow
from stiction_envs.errors import StictionError


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="DISPLAY is of X11")
def test_a_display_that_is_not_there_is_one_line_too(view, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(StictionError, match="view: the display cannot be opened: `stiction sje"):
        PushWindow(view)


def test_on_a_mac_one_line_says_mjpython(view, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(StictionError, match="mjpython"):
        PushWindow(view)


class Viewer:
    """As MuJoCo's passive viewer, without a window; presses keys and closes itself."""

    def __init__(self, model, data, keys):
        import contextlib
        import types

        import mujoco

        self.keys, self.frames, self.words, self.told = keys, 0, None, None
        self.cam, self.opt = mujoco.MjvCamera(), mujoco.MjvOption()
        self.user_scn = mujoco.MjvScene(model, 200)
        self.lock = contextlib.nullcontext
        self.data = data
        self.press: object = None
        self.close = types.SimpleNamespace

    def is_running(self):
        self.frames += 1
        if self.keys:
            self.press(self.keys.pop(0))
        return self.frames < 6

    def set_texts(self, texts):
        self.words = texts

    def set_images(self, images):
        self.image = images[1]

    def sync(self):
        # as if the viewer had taken "2" as its own key
        self.opt.geomgroup[2] = 0
        self.drawn = self.user_scn.ngeom


def test_the_window_runs_keys_and_draws(view, monkeypatch):
    viewers = []

    def open_viewer(what, model, data, key_callback):
        viewers.append(Viewer(model, data, [ord("2"), UP]))
        viewers[0].press = key_callback
        return viewers[0]

    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(window, "open_viewer", open_viewer)
    said: list[str] = []
    face = PushWindow(view)
    face.run(said.append)
    viewer = viewers[0]
    assert view.push.joint == 2
    assert view.push.target > 0
    assert view.time > 0
    assert said[-1] == "Panda  joint 2, holds"
    assert viewer.image.shape == (HEIGHT, WIDTH, 3)
    assert viewer.drawn > 5, "the dial"
    q = viewer.data.qpos[:7]
    assert np.allclose(q, view.push.plant.position[0])
    face._draw()
    viewer.sync = lambda: None
    face._draw()
    assert viewer.opt.geomgroup[2] == 1, "our keys switch nothing of the viewer's"
    face.close()
