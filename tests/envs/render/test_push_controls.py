"""What keys do, what is written, and how time passes."""

from __future__ import annotations

import itertools
import queue

import pytest

from stiction_envs.envs.render import push_controls
from stiction_envs.envs.render.push_controls import DOWN, HEIGHT, SPACE, UP, WIDTH, D, R, play


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


class Clock:
    """Time that passes while one sleeps, and while an arm is simulated at a speed."""

    def __init__(self, controls, speed):
        self.now, self.controls, self.speed, self.simulated = 0.0, controls, speed, 0.0

    def monotonic(self):
        self.now += (self.controls.time - self.simulated) / self.speed
        self.simulated = self.controls.time
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.mark.parametrize(("speed", "real"), [(50.0, 1.0), (0.5, 0.5)])
def test_time_passes_as_outside_or_as_fast_as_the_machine_is(controls, monkeypatch, speed, real):
    """A machine that is half as fast as needed shows half of the time, and never hurries after."""
    clock = Clock(controls, speed)
    monkeypatch.setattr(push_controls, "time", clock)
    pictures, said = [], []
    keys: queue.SimpleQueue[int] = queue.SimpleQueue()
    keys.put(UP)
    play(
        controls,
        keys,
        lambda: pictures.append(clock.now),
        said.append,
        is_open=lambda: clock.now < 4.0,
        period=0.1,
    )
    assert controls.time / clock.now == pytest.approx(real, abs=0.1)
    assert min(b - a for a, b in itertools.pairwise(pictures)) > 0.09
    assert controls.push.target > 0
    assert said == ["Panda  joint 1, rests", "Panda  joint 1, holds"]
