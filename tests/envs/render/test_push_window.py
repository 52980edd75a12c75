"""What keys do and what is written; the window itself is a thin face of both."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from stiction_envs.envs.render import window
from stiction_envs.envs.render.push_window import HEIGHT, WIDTH, PushControls, PushWindow
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.push import Push
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured import AmplitudeRow

SPACE, D, R, DOWN, UP = 32, 68, 82, 264, 265


@pytest.fixture
def controls():
    return PushControls(Push(sticking_model("panda"), dither=[AmplitudeRow(7, 15.0, 0.8)]))


def test_keys_push_a_joint_until_dither_lets_it_go(controls):
    push = controls.push
    assert controls.press(ord("7"))
    assert push.joint == 7
    assert controls.state == "rests"
    for _ in range(9):
        assert controls.press(UP)
    controls.advance(20.0)
    assert push.torque == pytest.approx(0.9 * push.holds_up_to(1.0), rel=1e-3)
    assert controls.state == "holds"
    assert "90 % of the +0.57 N·m that friction holds alone" in controls.lines
    assert controls.dither == "dither off: 0.80 N·m at 15 Hz"
    assert controls.press(SPACE)
    assert controls.dither == "dither ON: 0.80 N·m at 15 Hz"
    seen = set()
    for _ in range(80):
        controls.advance(0.05)
        seen.add(controls.state.split(" (")[0])
    assert seen == {"holds", "slips", "rests"}
    assert "(let go at +0.51 N·m)" in controls.state


def test_dither_is_held_against_the_push_without_it(controls):
    push = controls.push
    controls.press(ord("7"))
    push.let_go, controls.base = 0.4, 0.8
    push.switch_dither()
    assert controls.state == "rests (let go at +0.40 N·m, −50 %)"
    push.switch_dither()
    assert controls.state == "rests (let go at +0.40 N·m)"


def test_the_other_keys(controls):
    push = controls.push
    controls.press(DOWN)
    assert push.target == pytest.approx(-0.1 * push.holds_up_to(1.0))
    controls.press(UP)
    assert push.target == 0.0
    controls.press(D)
    assert push.dithered
    assert controls.dither == "no dither for this joint"
    controls.press(UP)
    controls.advance(0.5)
    controls.press(R)
    assert push.target == push.torque == 0.0
    assert not controls.trace
    for key in (ord("8"), ord("9"), ord("0"), ord("X"), 300):
        assert not controls.press(key)
    assert push.joint == 1


def test_time_passes_in_whole_blocks_and_is_drawn(controls):
    before = controls.panel()
    assert before.shape == (HEIGHT, WIDTH, 3)
    assert controls.advance(0.12) == pytest.approx(0.1)
    assert controls.time == pytest.approx(0.1)
    controls.press(UP)
    for _ in range(40):
        controls.advance(0.05)
    assert len(controls.trace) == 41
    drawn = controls.panel()
    blue = (drawn[:, :, 2].astype(int) - drawn[:, :, 0]) > 100
    assert blue.sum() > 20
    assert (drawn != before).any(axis=2).sum() > 100


def test_without_a_display_one_line_names_what_needs_none(controls, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: False)
    with pytest.raises(StictionError, match=r"view: no display found: `stiction sje panda .*--vid"):
        PushWindow(controls)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="DISPLAY is of X11")
def test_a_display_that_is_not_there_is_one_line_too(controls, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(StictionError, match="view: the display cannot be opened: `stiction sje"):
        PushWindow(controls)


def test_on_a_mac_one_line_says_mjpython(controls, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(StictionError, match="mjpython"):
        PushWindow(controls)


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


def test_the_window_runs_keys_and_draws(controls, monkeypatch):
    viewers = []

    def open_viewer(what, model, data, key_callback):
        viewers.append(Viewer(model, data, [ord("2"), UP]))
        viewers[0].press = key_callback
        return viewers[0]

    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(window, "open_viewer", open_viewer)
    said: list[str] = []
    face = PushWindow(controls)
    face.run(said.append)
    viewer = viewers[0]
    assert controls.push.joint == 2
    assert controls.push.target > 0
    assert controls.time > 0
    assert said[-1] == "Panda  joint 2, holds"
    assert viewer.image.shape == (HEIGHT, WIDTH, 3)
    assert viewer.drawn > 5, "the dial"
    q = viewer.data.qpos[:7]
    assert np.allclose(q, controls.push.plant.position[0])
    face._draw()
    viewer.sync = lambda: None
    face._draw()
    assert viewer.opt.geomgroup[2] == 1, "our keys switch nothing of the viewer's"
    face.close()
