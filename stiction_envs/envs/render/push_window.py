"""MuJoCo's viewer with a sticking arm: keys push a joint and switch its dither."""

import queue
import sys
import time
from collections.abc import Callable

import mujoco
import numpy as np

from stiction_envs.envs.render.arm_scene import ArmScene, draw_joint
from stiction_envs.envs.render.window import Window, check_display
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.pushed_joint import PushedJoint
from stiction_envs.plant import CONTROL_DT
from stiction_envs.reporting.markdown import signed
from stiction_envs.robots import arm_title

KEYS = "1-9 joint   up/down push   space or D dither   R reset"
SPACE, D, R, DOWN, UP, ONE = 32, 68, 82, 264, 265, 49
"""As GLFW numbers its keys."""
# what follows is assumed
_ELEVATION = -35.0  # of the camera [°]
_LONGEST = 1.0  # most that is simulated between two pictures [s]
_PAUSE = 0.01  # least time between two pictures [s]
_SLIPPING = 0.1  # share of the threshold beyond which a joint counts as slipping [-]


class PushView:
    """Applies keys to a push, and says and draws how it goes."""

    def __init__(self, push: PushedJoint) -> None:
        """Show a push; OpenGL is not touched yet."""
        self.push = push
        self.time = 0.0
        """Simulated [s]."""
        self.arm = ArmScene(push.plant.sticking.arm)
        self.arm.pose(push.plant.position[0])

    def press(self, key: int) -> None:
        """Apply a key; others than those of `KEYS` do nothing."""
        push, joint = self.push, key - ONE + 1
        if key in (UP, DOWN):
            push.harder(1.0 if key == UP else -1.0)
        elif key in (SPACE, D):
            push.switch_dither()
        elif key == R:
            push.reset()
        elif 1 <= joint <= min(push.n, 9):
            push.choose(joint)

    def advance(self, seconds: float) -> float:
        """Simulate some time; returns how much it was, a multiple of the push's block [s]."""
        push, block = self.push, self.push.block * CONTROL_DT
        passed = max(1, round(seconds / block)) * block
        push.advance(passed)
        self.time += passed
        return passed

    @property
    def state(self) -> str:
        """State of the joint as text."""
        push = self.push
        text = "holds" if push.torque else "rests"
        if push.slips or abs(push.angle) > _SLIPPING * push.threshold:
            text = "slips"
        if push.let_go is None:
            return text
        return f"{text} (let go at {signed(push.let_go, 2)} N·m)"

    @property
    def lines(self) -> list[str]:
        """Joint, dither, torque and state in lines of text."""
        push, row = self.push, self.push.rows.get(self.push.joint)
        dither = "no dither for this joint"
        if row is not None:
            switch = "ON" if push.dithered else "off"
            dither = f"dither {switch}: {row.amplitude_nm:.2f} N·m at {row.frequency_hz:g} Hz"
        holds = push.holds_up_to(push.target)
        sign = -1.0 if push.target < 0 else 1.0
        share = abs(push.torque) / holds if holds > 0 else np.inf
        return [
            f"{arm_title(push.plant.sticking.arm.name)}  joint {push.joint}",
            dither,
            f"torque {signed(push.torque, 2)} N·m, going to {signed(push.target, 2)} N·m",
            f"{100 * share:.0f} % of the {signed(sign * holds, 2)} N·m that friction holds alone",
            self.state,
        ]

    def draw(self, scene: mujoco.MjvScene) -> None:
        """Pose the arm, empty the scene, and draw the joint into it."""
        push = self.push
        self.arm.pose(push.plant.position[0])
        scene.ngeom = 0
        sign = -1.0 if push.target < 0 or (push.let_go or 0.0) < 0 else 1.0
        draw_joint(scene, self.arm, push.joint - 1, push.angle, sign * push.threshold)


class PushWindow:
    """The viewer's window; it runs in real time if the machine is fast enough."""

    def __init__(self, view: PushView) -> None:
        """Open the window.

        Raises:
            StictionError: no display, or on a Mac outside of mjpython.
        """
        check_display(what := "view", 'render_mode="rgb_array" of an environment needs none')
        if sys.platform == "darwin":
            import mujoco.viewer as shown

            if getattr(shown, "_MJPYTHON", None) is None:
                raise StictionError(
                    f"{what}: on a Mac: expected `mjpython $(which stiction) view …`"
                )
        self.view = view
        self._keys: queue.SimpleQueue[int] = queue.SimpleQueue()
        camera = view.arm.camera()
        camera.elevation = _ELEVATION
        # the viewer calls back in its own thread
        self._window = Window(what, view.arm.model, view.arm.data, camera, self._keys.put)
        self._viewer = self._window.viewer
        self._flags = self._viewer.opt.flags.copy(), self._viewer.opt.geomgroup.copy()

    def run(self, report: Callable[[str], None]) -> None:
        """Show the arm until the window is closed; ``report`` is called with changes of state."""
        view, reported, began = self.view, "", time.monotonic()
        behind = 0.0
        while self._viewer.is_running():
            while not self._keys.empty():
                view.press(self._keys.get())
            # a machine that is too slow simulates less than real time
            due = min(time.monotonic() - began - behind - view.time, _LONGEST)
            if due > 0:
                passed = view.advance(due)
                behind = max(behind, time.monotonic() - began - view.time - passed)
            self._draw()
            if (now := f"{view.lines[0]}, {view.state}") != reported:
                report(now)
                reported = now
            time.sleep(_PAUSE)

    def _draw(self) -> None:
        with self._viewer.lock():
            self.view.draw(self._viewer.user_scn)
            # the viewer has uses of its own for our keys: undo what they switched
            self._viewer.opt.flags[:], self._viewer.opt.geomgroup[:] = self._flags
        self._window.show([*self.view.lines, KEYS])

    def close(self) -> None:
        """Close the window."""
        self._window.close()
