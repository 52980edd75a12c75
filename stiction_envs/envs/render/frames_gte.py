"""Frames of the GTE: the arm, the path through its goals, where it is and where it should be."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.rotation import to_matrix
from stiction_envs.envs.render.frames import HEIGHT, PANEL_WIDTH, Renderer
from stiction_envs.envs.render.panel_gte import draw_gte_panel
from stiction_envs.envs.render.scene import MARK, PATH, ball, connect
from stiction_envs.plant import CONTROL_DT

if TYPE_CHECKING:
    from stiction_envs.envs.gte_core import GTECore

Array = NDArray[np.float64]
_AXES = np.array(
    [[0.85, 0.15, 0.15, 1.0], [0.1, 0.6, 0.2, 1.0], [0.15, 0.3, 0.9, 1.0]], dtype=np.float32
)
_TRAIL = 400  # segments of the tool point's trail at most
_LINE, _GOAL, _AXIS = 0.0025, 0.009, 0.12  # radius of lines and goals, length of an axis [m]
_NEARER = 0.8  # the arm keeps its shape: the camera can come nearer than for any pose


class PathRenderer(Renderer):
    """Draws the GTE."""

    _core: GTECore

    def _panel(self, i: int) -> NDArray[np.uint8]:
        return draw_gte_panel(self._core, i, PANEL_WIDTH, HEIGHT)

    def _words(self, i: int) -> tuple[str, str]:
        trajectory, stiffness = self._core.case[i]
        return "trajectory\nstiffness", f"{trajectory}\n{' '.join(f'{k:g}' for k in stiffness)}"

    def _points(self, i: int) -> Array:
        """Return the points of the arm at its start, so that the camera rests, and the path."""
        now = self._data.qpos.copy()
        self._data.qpos[self._model.jnt_qposadr[self._joints]] = self._core.rig.start
        mujoco.mj_kinematics(self._model, self._data)
        points = super()._points(i)
        self._data.qpos[:] = now
        mujoco.mj_forward(self._model, self._data)
        return np.vstack([self._core.path_points(i), points])

    def _camera(self, i: int) -> mujoco.MjvCamera:
        camera = super()._camera(i)
        camera.distance *= _NEARER
        return camera

    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        core = self._core
        capsule, arrow = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_ARROW
        self._arm.draw_chain(scene, 0.03)
        path, reached = core.path_points(i), int(core.rig.sequencer.index[i])
        for a, b in pairwise(path):
            connect(scene, capsule, _LINE, a, b, PATH)
        for k, goal in enumerate(path[1:]):
            aim = k == reached
            ball(scene, _GOAL * (1.6 if aim else 1.0), goal, MARK if aim else PATH)
        assert core.recorder.trace is not None
        trail = core.recorder.trace[i].position
        if trail:
            points = np.concatenate(trail)
            points = points[:: 1 + len(points) // _TRAIL]
            points = np.vstack([points, core.rig.end_effector.position[i]])
            for a, b in pairwise(points):
                connect(scene, capsule, _LINE, a, b, MARK)
        t = np.multiply(core.rig.step, CONTROL_DT, dtype=np.float64)
        x, quaternion, _, _ = core.rig.sequencer.reference(t)
        for axis, colour in zip(to_matrix(quaternion[i]).T, _AXES, strict=True):
            connect(scene, arrow, 2.0 * _LINE, x[i], x[i] + _AXIS * axis, colour)
