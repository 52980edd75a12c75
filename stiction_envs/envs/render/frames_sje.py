"""Frames of the SJE: the arm, and a ring about the joint under test."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.frames import HEIGHT, PANEL_WIDTH, Renderer
from stiction_envs.envs.render.panel_sje import draw_sje_panel
from stiction_envs.envs.render.scene import connect

if TYPE_CHECKING:
    from stiction_envs.envs.sje_core import SJECore

_RING = 36  # segments


class JointRenderer(Renderer):
    """Draws the SJE: a ring about the joint under test, its torque and angle."""

    _core: SJECore

    def _panel(self, i: int) -> NDArray[np.uint8]:
        return draw_sje_panel(self._core, i, PANEL_WIDTH, HEIGHT)

    def _words(self, i: int) -> tuple[str, str]:
        c = self._core.configuration[i]
        return "joint\nload\ndirection", f"{c.joint}\n{c.load}\n{c.direction}"

    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        """Draw a ring about the axis of the joint under test, with an arrow along the ramp."""
        joint = self._joints[self._core.rig.joint[i]]
        centre, axis = self._data.xanchor[joint], self._data.xaxis[joint]
        first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        radius = 0.15 * max(0.3, min(1.0, float(np.ptp(self._points(i), axis=0).max())))
        sign = self._core.rig.sign[i]
        turn = sign * np.linspace(0, 1.75 * np.pi, _RING)[:, None]
        ring = centre + radius * (np.cos(turn) * first + np.sin(turn) * second)
        for a, b in pairwise(ring):
            connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.06 * radius, a, b)
        tangent = sign * (np.cos(turn[-1]) * second - np.sin(turn[-1]) * first)
        tip = ring[-1] + 0.45 * radius * tangent
        connect(scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.12 * radius, ring[-1], tip)
        ends = centre - 1.3 * radius * axis, centre + 1.3 * radius * axis
        connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.03 * radius, *ends)
        self._arm.draw_chain(scene, 0.3 * radius)
