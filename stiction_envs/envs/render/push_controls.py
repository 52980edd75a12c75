"""What a person does to a joint that sticks, and what is shown of it, in a window or a page.

`PushControls` says what each key does and what is written; `play` lets time pass.
"""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.panel import BLUE, ORANGE, SOFT, Plot, new_panel, signed
from stiction_envs.experiments.sje.push import Push
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots.registry import arm_title

WIDTH, HEIGHT = 380, 430
"""Of the panel [pixel]."""
KEYS = "1-9 joint   up/down push   space or D dither   R reset"
# as GLFW numbers its keys
SPACE, D, R, DOWN, UP, ONE, NINE = 32, 68, 82, 264, 265, 49, 57
_SPAN = 20.0  # of the plots [s]
_MOST = 1.0  # simulated between two pictures [s]
_PAUSE = 0.01  # between two pictures, at least [s]
_SLIP = 0.1  # part of the threshold that a joint has moved by which slips
_SAMPLE = 0.05  # between two of their points [s]


class PushControls:
    """What the keys do to a push, and what there is to say about it."""

    def __init__(self, push: Push) -> None:
        """Take over a push."""
        self.push = push
        self.time = 0.0
        """Simulated [s]."""
        self.trace: deque[tuple[float, float, float]] = deque(maxlen=round(_SPAN / _SAMPLE))
        """Time [s], torque [N·m] and angle [rad] of the joint that is pushed."""
        self.choices = 0
        """How often another joint was chosen, or the arm brought back."""
        self.base: float | None = None
        """Torque at which this joint last let go without dither [N·m]."""
        self._sampled = -np.inf

    def press(self, key: int) -> bool:
        """Do what a key (GLFW code) stands for; returns whether it stands for anything."""
        push = self.push
        if key in (UP, DOWN):
            push.harder(1.0 if key == UP else -1.0)
        elif key in (SPACE, D):
            push.switch_dither()
        elif key == R:
            push.reset()
            self._begin()
        elif ONE <= key <= NINE and key - ONE < push.n:
            push.choose(key - ONE + 1)
            self._begin()
            self.base = None
        else:
            return False
        return True

    def _begin(self) -> None:
        self.choices += 1
        self.trace.clear()

    def advance(self, seconds: float) -> float:
        """Let time pass; returns how much did: whole blocks of the push [s]."""
        push, block = self.push, self.push.block * CONTROL_DT
        passed = max(1, round(seconds / block)) * block
        before = push.let_go
        push.advance(passed)
        self.time += passed
        if push.let_go is not None and push.let_go != before and push.row is None:
            self.base = push.let_go
        if self.time - self._sampled >= _SAMPLE - 1e-9:
            self.trace.append((self.time, push.torque, push.angle))
            self._sampled = self.time
        return passed

    # ---- words -------------------------------------------------------------------------------

    @property
    def state(self) -> str:
        """What the joint does."""
        push = self.push
        text = "holds" if push.torque else "rests"
        if push.slips or abs(push.angle) > _SLIP * push.threshold:
            text = "slips"
        if push.let_go is not None:
            text += f" (let go at {signed(push.let_go)} N·m"
            base = self.base
            if push.row is not None and base is not None and base * push.let_go > 0:
                change = 100 * (push.let_go / base - 1)
                text += f", {change:+.0f} %".replace("-", "−")
            text += ")"
        return text

    @property
    def dither(self) -> str:
        """Which dither is on."""
        push = self.push
        row = push.rows.get(push.joint)
        if row is None:
            return "no dither for this joint"
        return f"dither {'ON' if push.dithered else 'off'}: {row.amplitude_nm:.2f} N·m at " + (
            f"{row.frequency_hz:g} Hz"
        )

    @property
    def lines(self) -> list[str]:
        """What there is to know, in lines."""
        push = self.push
        holds = push.holds_up_to(push.target)
        sign = -1.0 if push.target < 0 else 1.0
        share = abs(push.torque) / holds if holds > 0 else np.inf
        return [
            f"{arm_title(push.plant.sticking.arm.name)}  joint {push.joint}",
            self.dither,
            f"torque {signed(push.torque)} N·m, going to {signed(push.target)} N·m",
            f"{100 * share:.0f} % of the {signed(sign * holds)} N·m that friction holds alone",
        ]

    def panel(self) -> NDArray[np.uint8]:
        """Return the panel (HEIGHT, WIDTH, 3): words, torque and angle over time."""
        push = self.push
        image, draw = new_panel(WIDTH, HEIGHT, self.lines, self.state)
        samples = np.array(self.trace).reshape(-1, 3)
        end = max(_SPAN, self.time)
        holds = [push.holds_up_to(1.0), -push.holds_up_to(-1.0)]
        shown = samples[samples[:, 0] >= end - _SPAN]
        for top, bottom, column, title, levels, least, colour in (
            (138, 240, 1, "torque, dither excluded [N·m]", holds, 1.4, BLUE),
            (278, HEIGHT - 42, 2, "angle since it rested [rad]", [], 1.0, ORANGE),
        ):
            edges = levels or [push.threshold, -push.threshold]
            high = max(least * edges[0], *shown[:, column], 0.0) if len(shown) else least * edges[0]
            low = min(least * edges[1], *shown[:, column], 0.0) if len(shown) else least * edges[1]
            box = (58, top, WIDTH - 14, bottom)
            plot = Plot(draw, box, (end - _SPAN, end), (low, high), title)
            for level in levels:
                plot.level(level, SOFT, "friction alone")
            if len(shown) > 1:
                plot.line(shown[:, 0], shown[:, column], colour)
        plot.time_label()
        return np.array(image, dtype=np.uint8)


def play(
    controls: PushControls,
    keys: queue.SimpleQueue[int],
    draw: Callable[[], None],
    say: Callable[[str], None],
    *,
    is_open: Callable[[], bool],
    period: float = 0.0,
) -> None:
    """Let time pass as it does outside, as far as the machine is fast enough.

    Args:
        controls: the push.
        keys: that somebody pressed, GLFW codes; another thread may add to them.
        draw: shows the push as it is now.
        say: is told of every change of state.
        is_open: whether to go on.
        period: from one picture to the next, at least [s].
    """
    told, began = "", time.monotonic()
    behind = 0.0
    while is_open():
        drawn = time.monotonic()
        while not keys.empty():
            controls.press(keys.get())
        # where the machine is too slow, time passes slower
        due = min(time.monotonic() - began - behind - controls.time, _MOST)
        if due > 0:
            passed = controls.advance(due)
            behind = max(behind, time.monotonic() - began - controls.time - passed)
        draw()
        if (now := f"{controls.lines[0]}, {controls.state}") != told:
            say(now)
            told = now
        time.sleep(max(_PAUSE, drawn + period - time.monotonic()))
