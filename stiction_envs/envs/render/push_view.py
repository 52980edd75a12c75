"""An arm that a person pushes: controls, texts, plots and scene of a window or a page."""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.panel import (
    BLUE,
    ORANGE,
    SLIPPING,
    SOFT,
    Plot,
    draw_panel,
    signed,
)
from stiction_envs.experiments.sje.push import Push
from stiction_envs.plant import CONTROL_DT

WIDTH, HEIGHT = 380, 430
"""Of the panel [pixel]."""
KEYS = "1-9 joint   up/down push   space or D dither   R reset"
SPACE, D, R, DOWN, UP, ONE = 32, 68, 82, 264, 265, 49
"""As GLFW numbers its keys."""
# what follows is assumed
_ELEVATION = -35.0  # of the camera [°]
_SPAN = 20.0  # of the plots [s]
_LONGEST = 1.0  # most that is simulated between two pictures [s]
_PAUSE = 0.01  # least time between two pictures [s]
_SAMPLE = 0.05  # between two points of the plots [s]


class Control(NamedTuple):
    """A control: a key of the window, a hotkey of the page."""

    label: str
    key: int
    """In the window, GLFW's number."""
    hotkey: str
    """On the page, viser's name."""


class PushView:
    """Applies controls to a push, and shows it."""

    def __init__(self, push: Push) -> None:
        """Show a push; OpenGL is not touched yet."""
        self.push = push
        self.time = 0.0
        """Simulated [s]."""
        self.trace: deque[tuple[float, float, float]] = deque(maxlen=round(_SPAN / _SAMPLE))
        """Time [s], torque [N·m] and angle [rad] of the joint that is pushed."""
        self.base: float | None = None
        """Torque at which this joint last broke away without dither [N·m]."""
        self.controls = [
            *(Control(f"Joint {j}", ONE - 1 + j, str(j)) for j in range(1, min(push.n, 9) + 1)),
            Control("Push harder", UP, "arrowup"),
            Control("Push softer", DOWN, "arrowdown"),
            Control("Dither on or off", SPACE, "space"),
            Control("Dither on or off (D)", D, "D"),
            Control("Reset the arm", R, "R"),
        ]
        """All controls."""
        self.keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        """Keys that `run` will apply; other threads may add to them."""
        self._sampled = -np.inf
        self._arm = ArmScene(push.plant.sticking.arm, WIDTH, HEIGHT)
        self.model, self.data = self._arm.model, self._arm.data
        self._dial: Dial | None = None
        self._arm.pose(push.plant.position[0])
        self.camera = self._arm.camera(self._arm.points)
        """Camera that sees the whole arm."""
        self.camera.elevation = _ELEVATION

    # ---- controls and time -------------------------------------------------------------------

    def press(self, key: int) -> bool:
        """Apply a key; returns whether it is one of `controls`."""
        push = self.push
        if not any(key == c.key for c in self.controls):
            return False
        if key in (UP, DOWN):
            push.harder(1.0 if key == UP else -1.0)
        elif key in (SPACE, D):
            push.switch_dither()
        else:
            if key == R:
                push.reset()
            else:
                push.choose(key - ONE + 1)
                self.base = None
            self.trace.clear()
            self._dial = None
        return True

    def advance(self, seconds: float) -> float:
        """Simulate some time; returns how much it was, a multiple of the push's block [s]."""
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

    def run(
        self,
        draw: Callable[[], None],
        report: Callable[[str], None],
        *,
        is_open: Callable[[], bool],
        period: float = 0.0,
    ) -> None:
        """Simulate in real time if the machine is fast enough, else slower.

        Args:
            draw: shows the present state.
            report: called with a text at every change of state.
            is_open: whether to go on.
            period: least time from one picture to the next [s].
        """
        reported, began = "", time.monotonic()
        behind = 0.0
        while is_open():
            drawn = time.monotonic()
            while not self.keys.empty():
                self.press(self.keys.get())
            # a machine that is too slow simulates less than real time
            due = min(time.monotonic() - began - behind - self.time, _LONGEST)
            if due > 0:
                passed = self.advance(due)
                behind = max(behind, time.monotonic() - began - self.time - passed)
            draw()
            if (now := f"{self.lines[0]}, {self.state}") != reported:
                report(now)
                reported = now
            time.sleep(max(_PAUSE, drawn + period - time.monotonic()))

    # ---- words and plots ---------------------------------------------------------------------

    @property
    def state(self) -> str:
        """What the joint does, as text."""
        push = self.push
        text = "holds" if push.torque else "rests"
        if push.slips or abs(push.angle) > SLIPPING * push.threshold:
            text = "slips"
        if push.let_go is None:
            return text
        change, base = "", self.base
        if push.row is not None and base is not None and base * push.let_go > 0:
            change = f", {signed(100 * (push.let_go / base - 1), 0)} %"
        return f"{text} (let go at {signed(push.let_go)} N·m{change})"

    @property
    def dither(self) -> str:
        """Which dither is on, as text."""
        row = self.push.rows.get(self.push.joint)
        if row is None:
            return "no dither for this joint"
        switch = "ON" if self.push.dithered else "off"
        return f"dither {switch}: {row.amplitude_nm:.2f} N·m at {row.frequency_hz:g} Hz"

    @property
    def lines(self) -> list[str]:
        """The state in lines of text."""
        push = self.push
        holds = push.holds_up_to(push.target)
        sign = -1.0 if push.target < 0 else 1.0
        share = abs(push.torque) / holds if holds > 0 else np.inf
        return [
            f"{push.plant.sticking.arm.title}  joint {push.joint}",
            self.dither,
            f"torque {signed(push.torque)} N·m, going to {signed(push.target)} N·m",
            f"{100 * share:.0f} % of the {signed(sign * holds)} N·m that friction holds alone",
        ]

    def panel(self) -> NDArray[np.uint8]:
        """Return the panel (HEIGHT, WIDTH, 3): texts, torque and angle over time."""
        return draw_panel(WIDTH, HEIGHT, self.lines, self.state, self._plot)

    def _plot(self, draw: ImageDraw.ImageDraw) -> None:
        push = self.push
        samples = np.array(self.trace).reshape(-1, 3)
        end = max(_SPAN, self.time)
        holds = [push.holds_up_to(1.0), -push.holds_up_to(-1.0)]
        shown = samples[samples[:, 0] >= end - _SPAN]
        for top, bottom, column, title, levels, least, colour in (
            (138, 240, 1, "torque, dither excluded [N·m]", holds, 1.4, BLUE),
            (278, HEIGHT - 42, 2, "angle since it rested [rad]", [], 1.0, ORANGE),
        ):
            edges = np.multiply(least, levels or [push.threshold, -push.threshold])
            limits = min([*edges, *shown[:, column]]), max([*edges, *shown[:, column]])
            box = (58, top, WIDTH - 14, bottom)
            plot = Plot(draw, box, (end - _SPAN, end), limits, title)
            for level in levels:
                plot.level(level, SOFT, "friction alone")
            if len(shown) > 1:
                plot.line(shown[:, 0], shown[:, column], colour)
        plot.time_label()

    # ---- scene -------------------------------------------------------------------------------

    def draw(self, scene: mujoco.MjvScene) -> None:
        """Pose the arm, empty the scene, and draw into it what the model does not have."""
        push = self.push
        self._arm.pose(push.plant.position[0])
        scene.ngeom = 0
        self._arm.draw_chain(scene)
        sign = -1.0 if push.target < 0 or (push.let_go or 0.0) < 0 else 1.0
        # the arm may have moved since a joint was last chosen
        self._dial = self._dial or Dial(self._arm, push.joint - 1)
        self._dial.draw(scene, push.angle, sign * push.threshold)
