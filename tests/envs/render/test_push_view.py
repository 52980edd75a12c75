"""What keys do, what is written, and how time passes."""

from __future__ import annotations

import itertools

import pytest

from stiction_envs.envs.render import push_view
from stiction_envs.envs.render.push_view import DOWN, HEIGHT, SPACE, UP, WIDTH, D, R


def test_keys_push_a_joint_until_dither_lets_it_go(view):
    push = view.push
    assert view.press(ord("7"))
    assert push.joint == 7
    assert view.state == "rests"
    for _ in range(9):
        assert view.press(UP)
    view.advance(20.0)
    assert push.torque == pytest.approx(0.9 * push.holds_up_to(1.0), rel=1e-3)
    assert view.state == "holds"
    assert "90 % of the +0.57 N·m that friction holds alone" in view.lines
    assert view.dither == "dither off: 0.80 N·m at 15 Hz"
    assert view.press(SPACE)
    assert view.dither == "dither ON: 0.80 N·m at 15 Hz"
    seen = set()
    for _ in range(80):
        view.advance(0.05)
        seen.add(view.state.split(" (")[0])
    assert seen == {"holds", "slips", "rests"}
    assert "(let go at +0.51 N·m)" in view.state


def test_dither_is_held_against_the_push_without_it(view):
    push = view.push
    view.press(ord("7"))
    push.let_go, view.base = 0.4, 0.8
    push.switch_dither()
    assert view.state == "rests (let go at +0.40 N·m, −50 %)"
    push.switch_dither()
    assert view.state == "rests (let go at +0.40 N·m)"


def test_the_other_keys(view):
    push = view.push
    view.press(DOWN)
    assert push.target == pytest.approx(-0.1 * push.holds_up_to(1.0))
    view.press(UP)
    assert push.target == 0.0
    view.press(D)
    assert push.dithered
    assert view.dither == "no dither for this joint"
    view.press(UP)
    view.advance(0.5)
    view.press(R)
    assert push.target == push.torque == 0.0
    assert not view.trace
    for key in (ord("8"), ord("9"), ord("0"), ord("X"), 300):
        assert not view.press(key)
    assert push.joint == 1


def test_time_passes_in_whole_blocks_and_is_drawn(view):
    before = view.panel()
    assert before.shape == (HEIGHT, WIDTH, 3)
    assert view.advance(0.12) == pytest.approx(0.1)
    assert view.time == pytest.approx(0.1)
    view.press(UP)
    for _ in range(40):
        view.advance(0.05)
    assert len(view.trace) == 41
    drawn = view.panel()
    blue = (drawn[:, :, 2].astype(int) - drawn[:, :, 0]) > 100
    assert blue.sum() > 20
    assert (drawn != before).any(axis=2).sum() > 100


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
def test_time_passes_as_outside_or_as_fast_as_the_machine_is(view, monkeypatch, speed, real):
    """A machine that is half as fast as needed shows half of the time, and never hurries after."""
    clock = Clock(view, speed)
    monkeypatch.setattr(push_view, "time", clock)
    pictures, said = [], []
    view.keys.put(UP)
    view.run(
        lambda: pictures.append(clock.now),
        said.append,
        is_open=lambda: clock.now < 4.0,
        period=0.1,
    )
    assert view.time / clock.now == pytest.approx(real, abs=0.1)
    assert min(b - a for a, b in itertools.pairwise(pictures)) > 0.09
    assert view.push.target > 0
    assert said == ["Panda  joint 1, rests", "Panda  joint 1, holds"]
