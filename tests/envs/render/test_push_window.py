"""MuJoCo's viewer on a pushed arm: keys, messages, simulated time."""

import contextlib
import sys

import mujoco.viewer
import numpy as np
import pytest

from stiction_envs.envs.render import push_window, window
from stiction_envs.envs.render.push_window import SPACE, UP, PushView, PushWindow
from stiction_envs.experiments.sje.pushed_joint import PushedJoint
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured.tables import AmplitudeRow
from tests.refusal import refusal


@pytest.fixture
def view():
    return PushView(PushedJoint(sticking_model("panda"), dither=[AmplitudeRow(7, 15.0, 0.8)]))


def test_keys_push_a_joint_until_dither_lets_it_go(view):
    push = view.push
    view.press(ord("7"))
    assert push.joint == 7
    assert view.state == "rests"
    for _ in range(9):
        view.press(UP)
    view.advance(20.0)
    assert push.torque == pytest.approx(0.9 * push.holds_up_to(1.0), rel=1e-3)
    assert view.state == "holds"
    assert "90 % of the +0.57 N·m that friction holds alone" in view.lines
    assert "dither off: 0.80 N·m at 15 Hz" in view.lines
    view.press(SPACE)
    assert "dither ON: 0.80 N·m at 15 Hz" in view.lines
    seen = set()
    for _ in range(80):
        view.advance(0.05)
        seen.add(view.state.split(" (")[0])
    assert seen == {"holds", "slips", "rests"}
    assert "(let go at +0.51 N·m)" in view.state


class Viewer:
    """Replaces MuJoCo's passive viewer, without a window; presses keys and closes."""

    def __init__(self, model, data, press, keys, until):
        self.press, self.keys, self.until, self.data = press, keys, until, data
        self.cam, self.opt = mujoco.MjvCamera(), mujoco.MjvOption()
        self.user_scn = mujoco.MjvScene(model, 200)
        self.lock = contextlib.nullcontext

    def is_running(self):
        if self.keys:
            self.press(self.keys.pop(0))
        return self.until()

    def set_texts(self, texts):
        self.text = texts[2]

    def sync(self):
        self.groups = self.opt.geomgroup.copy()
        # as if the viewer had taken "2" as its own key
        self.opt.geomgroup[2] = 0

    def close(self):
        self.until = lambda: False


class Clock:
    """Time that passes while one sleeps, and while an arm is simulated at a speed."""

    def __init__(self, view, speed):
        self.now, self.view, self.speed, self.simulated = 0.0, view, speed, 0.0

    def monotonic(self):
        self.now += (self.view.time - self.simulated) / self.speed
        self.simulated = self.view.time
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.mark.parametrize(("speed", "real"), [(50.0, 1.0), (0.5, 0.5)])
def test_the_window_runs_keys_in_real_time_or_as_fast_as_it_can(view, monkeypatch, speed, real):
    """A machine that is half as fast as needed shows half of the time, and never hurries after."""
    clock, viewers, said = Clock(view, speed), [], []

    def launch(model, data, *, key_callback, **_):
        keys = [ord("2"), UP]
        viewers.append(Viewer(model, data, key_callback, keys, lambda: clock.now < 4.0))
        return viewers[0]

    monkeypatch.setattr(push_window, "time", clock)
    monkeypatch.setattr(push_window, "_PAUSE", 0.1)
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    opened = PushWindow(view)
    opened.run(said.append)
    (viewer,) = viewers
    assert view.time / clock.now == pytest.approx(real, abs=0.1)
    assert view.push.joint == 2
    assert view.push.target > 0
    assert said == ["Panda  joint 2, rests", "Panda  joint 2, holds"]
    assert viewer.text.startswith("Panda  joint 2\nno dither for this joint\n")
    assert "space or D dither" in viewer.text
    assert viewer.user_scn.ngeom > 5, "the ring"
    assert np.allclose(viewer.data.qpos[:7], view.push.plant.position[0])
    assert viewer.groups[2] == 1, "our keys switch nothing of the viewer's"
    opened.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="DISPLAY is of X11")
def test_a_display_that_is_not_there_is_one_line(view, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    refusal(lambda: PushWindow(view), "view: the display cannot be opened: render_mode=")


def test_on_a_mac_one_line_says_mjpython(view, monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window, "_opens", lambda: True)
    monkeypatch.setattr(sys, "platform", "darwin")
    refusal(lambda: PushWindow(view), "mjpython")
