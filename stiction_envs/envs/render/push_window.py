"""MuJoCo's viewer on an arm that sticks: keys push a joint and switch its dither.

The window is a thin face of `Push`: `PushControls` says what each key does and what is written.
"""

from __future__ import annotations

import queue
import sys
import time
from collections import deque
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.panel import BLUE, ORANGE, SOFT, Plot, new_panel, signed
from stiction_envs.envs.render.scene import ArmScene
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.push import Push
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots.registry import arm_title

WIDTH, HEIGHT = 380, 430
"""Of the panel [pixel]."""
KEYS = "1-9 joint   up/down push   space or D dither   R reset"
_SPAN = 20.0  # of the plots [s]
_ELEVATION = -35.0  # of the camera [°]
_MOST = 1.0  # simulated between two pictures [s]
_SLIP = 0.1  # part of the threshold that a joint has moved by which slips
_SAMPLE = 0.05  # between two of their points [s]
# as GLFW numbers its keys
_SPACE, _D, _R, _DOWN, _UP, _ONE, _NINE = 32, 68, 82, 264, 265, 49, 57


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
        if key in (_UP, _DOWN):
            push.harder(1.0 if key == _UP else -1.0)
        elif key in (_SPACE, _D):
            push.switch_dither()
        elif key == _R:
            push.reset()
            self._begin()
        elif _ONE <= key <= _NINE and key - _ONE < push.n:
            push.choose(key - _ONE + 1)
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


class PushWindow:
    """The viewer's window; it runs in real time, as far as the machine is fast enough."""

    def __init__(self, controls: PushControls) -> None:
        """Open it.

        Raises:
            StictionError: no display, or on a Mac outside of mjpython.
        """
        what = "view"
        push = controls.push
        robot = push.plant.sticking.arm.name
        film = f"stiction sje {robot} --joint {push.joint} --dither TABLE.csv --video"
        check_display(what, f"`{film}` writes an mp4 without one")
        if sys.platform == "darwin" and not _in_mjpython():
            raise StictionError(f"{what}: on a Mac: expected `mjpython $(which stiction) view …`")
        self.controls = controls
        self._scene = ArmScene(push.plant.sticking.arm, WIDTH, HEIGHT)
        self._pose()
        self._dial, self._chosen = Dial(self._scene, push.joint - 1), controls.choices
        # the viewer calls back in its own thread
        self._keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        camera = self._scene.camera(self._scene.points)
        camera.elevation = _ELEVATION
        self._window = Window(what, self._scene.model, self._scene.data, camera, self._keys.put)
        self._viewer = self._window.viewer
        self._flags = self._viewer.opt.flags.copy(), self._viewer.opt.geomgroup.copy()

    def _pose(self) -> None:
        self._scene.pose(self.controls.push.plant.position[0])

    def run(self, say: Callable[[str], None]) -> None:
        """Show the arm until the window is closed; ``say`` is told of every change of state."""
        told, began = "", time.monotonic()
        behind = 0.0
        while self._viewer.is_running():
            while not self._keys.empty():
                self.controls.press(self._keys.get())
            # where the machine is too slow, time passes slower
            due = min(time.monotonic() - began - behind - self.controls.time, _MOST)
            if due > 0:
                passed = self.controls.advance(due)
                behind = max(behind, time.monotonic() - began - self.controls.time - passed)
            self._draw()
            if (now := f"{self.controls.lines[0]}, {self.controls.state}") != told:
                say(now)
                told = now
            time.sleep(0.01)

    def _draw(self) -> None:
        push = self.controls.push
        with self._viewer.lock():
            self._pose()
            scene = self._viewer.user_scn
            scene.ngeom = 0
            self._scene.draw_chain(scene, 0.03)
            sign = -1.0 if push.target < 0 or (push.let_go or 0.0) < 0 else 1.0
            if self._chosen != self.controls.choices:  # the arm may have moved in the meantime
                self._dial = Dial(self._scene, push.joint - 1)
                self._chosen = self.controls.choices
            self._dial.draw(scene, push.angle, sign * push.threshold)
            # our keys are the viewer's too: what they switch there stays as it was
            self._viewer.opt.flags[:], self._viewer.opt.geomgroup[:] = self._flags
        texts = (None, mujoco.mjtGridPos.mjGRID_BOTTOMLEFT, KEYS, "")
        self._window.show(self.controls.panel(), texts, bottom=60)

    def close(self) -> None:
        """Close the window."""
        self._window.close()


def _in_mjpython() -> bool:
    import mujoco.viewer

    return getattr(mujoco.viewer, "_MJPYTHON", None) is not None
