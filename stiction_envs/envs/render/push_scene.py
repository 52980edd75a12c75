"""The arm that a person pushes, with a dial about the joint, for a window or a page to show."""

from __future__ import annotations

import mujoco

from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.push_controls import HEIGHT, WIDTH, PushControls
from stiction_envs.envs.render.scene import ArmScene

_ELEVATION = -35.0  # of the camera [°]
_CHAIN = 0.03  # width of an arm without geometry [m]


class PushScene:
    """An arm posed as a push has it, and what is drawn about it."""

    def __init__(self, controls: PushControls) -> None:
        """Pose the arm."""
        self.controls = controls
        self._arm = ArmScene(controls.push.plant.sticking.arm, WIDTH, HEIGHT)
        self.model, self.data = self._arm.model, self._arm.data
        self._pose()
        self._new_dial()
        self.camera = self._arm.camera(self._arm.points)
        """Has the whole arm in view."""
        self.camera.elevation = _ELEVATION

    def _pose(self) -> None:
        self._arm.pose(self.controls.push.plant.position[0])

    def _new_dial(self) -> None:
        self._dial = Dial(self._arm, self.controls.push.joint - 1)
        self._chosen = self.controls.choices

    def draw(self, scene: mujoco.MjvScene) -> None:
        """Pose the arm, and draw all that is not of its model into an emptied scene."""
        push = self.controls.push
        self._pose()
        scene.ngeom = 0
        self._arm.draw_chain(scene, _CHAIN)
        sign = -1.0 if push.target < 0 or (push.let_go or 0.0) < 0 else 1.0
        if self._chosen != self.controls.choices:  # the arm may have moved in the meantime
            self._new_dial()
        self._dial.draw(scene, push.angle, sign * push.threshold)
