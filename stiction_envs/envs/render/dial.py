"""A dial about a joint: its angles at rest, now, and where it has broken away."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.arm_scene import MARK, ArmScene, ball, polyline

Array = NDArray[np.float64]
REST = np.array([0.2, 0.22, 0.27, 1.0], dtype=np.float32)
"""Colour of the angle at rest."""
LIMIT = np.array([0.08, 0.35, 0.7, 1.0], dtype=np.float32)
"""Colour of the angle at which the joint has broken away."""
_FILL = np.array([1.0, 0.62, 0.25, 1.0], dtype=np.float32)
# what follows is assumed: chosen by eye on the three shipped arms
_RADIUS, _LEAST, _MOST = 0.55, 0.22, 0.4  # over the reach of the moving part [-]; bounds [m]
_LIFTS = (0.0, 0.06, 0.11, 0.16, 0.22)  # of the dial along the axis, out of the links [m]
_ELEVATIONS = (-12.0, -28.0, -45.0, -62.0)  # of cameras that are tried [°]
_AZIMUTHS = range(0, 360, 20)  # likewise [°]
_LINE, _TIP = 0.022, 0.06  # width of a line, radius of the pointer's tip; over the radius [-]
_FAN = 16  # number of lines that fill the angle
_FACING, _TURNED = 0.75, 0.35  # best |view · axis| [-]; weight of facing against being seen [-]


class Dial:
    """A dial about one joint of a posed arm, and a camera that sees it."""

    def __init__(self, scene: ArmScene, joint: int) -> None:
        """Find its place; the arm is posed where the joint (from 0) is at rest."""
        self._scene, joint_id = scene, scene.joints[joint]
        data = scene.data
        self._axis = np.array(data.xaxis[joint_id])
        moved = np.vstack([data.xanchor[scene.joints[joint:]], scene.flange[None]])
        centre = np.array(data.xanchor[joint_id])
        reach = float(np.linalg.norm(moved - centre, axis=1).max())
        self._radius = float(np.clip(_RADIUS * reach, _LEAST, _MOST))
        self._first, self._second = self._directions(moved - centre)
        self._centre, self.camera = self._look(centre, moved)

    def _directions(self, arms: Array) -> tuple[Array, Array]:
        """Return the pointer's direction at rest, along the moving part, and 90° further."""
        across = arms - (arms @ self._axis)[:, None] * self._axis
        far = across[np.linalg.norm(across, axis=1).argmax()]
        if np.linalg.norm(far) < 0.02:  # all that moves is on the axis
            far = np.cross(self._axis, np.eye(3)[np.abs(self._axis).argmin()])
        first = far / np.linalg.norm(far)
        return first, np.cross(self._axis, first)

    def _look(self, centre: Array, moved: Array) -> tuple[Array, mujoco.MjvCamera]:
        """Return the centre of the dial and the camera with the best view of it."""
        turns = np.linspace(-0.6, 0.6, 7)
        rim = np.cos(turns)[:, None] * self._first + np.sin(turns)[:, None] * self._second
        best, found = -np.inf, (centre, mujoco.MjvCamera())
        corners = np.vstack([moved, centre + self._radius * rim])
        low, high = corners.min(axis=0), corners.max(axis=0)
        distance = self._scene.distance(float(np.linalg.norm(high - low)) / 2 + 0.06)
        for lift in (sign * x for x in _LIFTS for sign in (1.0, -1.0)):
            place = centre + lift * self._axis
            seen = np.vstack([place + s * self._radius * rim for s in (0.5, 1.0)])
            for elevation in _ELEVATIONS:
                for azimuth in _AZIMUTHS:
                    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
                    view = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
                    facing = min(abs(float(view @ self._axis)), _FACING) / _FACING
                    score = _TURNED * facing - 0.2 * abs(lift)
                    if score + 1.0 <= best:
                        continue
                    score += self._share_seen(seen, (low + high) / 2 - distance * view)
                    if score > best:
                        camera = mujoco.MjvCamera()
                        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
                        camera.lookat, camera.distance = (low + high) / 2, distance
                        camera.azimuth, camera.elevation = azimuth, elevation
                        best, found = score, (place, camera)
        return found

    def _share_seen(self, points: Array, eye: Array) -> float:
        """Return the share of points (K, 3) [m] that no link hides from ``eye`` (3,) [m]."""
        scene, shown = self._scene, np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        hit = np.zeros(1, dtype=np.int32)
        clear = 0
        for point in points:
            ray = point - eye
            # length in units of the ray; −1 where it meets nothing
            length = mujoco.mj_ray(scene.model, scene.data, eye, ray, shown, 1, -1, hit)
            clear += length < 0 or length >= 1.0
        return clear / len(points)

    def draw(self, scene: mujoco.MjvScene, angle: float, limit: float) -> None:
        """Draw it into a scene.

        Args:
            scene: what is rendered.
            angle: of the joint from its angle at rest [rad].
            limit: angle at which it has broken away [rad], signed.
        """
        width = _LINE * self._radius
        for a in np.linspace(0.0, angle, _FAN):
            polyline(scene, 0.6 * width, self._ray(a, 0.05, 0.92), _FILL)
        polyline(scene, 0.8 * width, self._ray(0.0, 0.0, 1.1), REST)
        polyline(scene, 0.8 * width, self._ray(limit, 0.55, 1.1), LIMIT)
        polyline(scene, 1.3 * width, self._ray(angle, 0.0, 1.0), MARK)
        ball(scene, _TIP * self._radius, self._at(angle, 1.0), MARK)
        ends = [self._centre + x * self._radius * self._axis for x in (-0.25, 0.06)]
        polyline(scene, 1.3 * width, np.array(ends), REST)

    def _ray(self, angle: float, start: float, end: float) -> Array:
        """Return the ends (2, 3) [m] of a line at an angle [rad], as shares of the radius."""
        return np.array([self._at(angle, start), self._at(angle, end)])

    def _at(self, angle: float, share: float) -> Array:
        """Return the point (3,) [m] at an angle [rad] and a share of the radius."""
        out: Array = self._centre + share * self._radius * (
            np.cos(angle) * self._first + np.sin(angle) * self._second
        )
        return out
