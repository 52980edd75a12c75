"""An arm on a floor, and shapes that are drawn into its scene."""

import os
import warnings
from collections.abc import Callable
from importlib import import_module
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array
from stiction_envs.envs.render.window import has_display
from stiction_envs.errors import StictionError, one_line
from stiction_envs.robots import Arm

Frame = NDArray[np.uint8]
"""A picture (height, width, 3)."""
Colour = NDArray[np.float32]
MARK = np.array([1.0, 0.45, 0.0, 1.0], dtype=np.float32)
"""Colour of the joint under test, and of the present goal."""
GREY = np.array([0.6, 0.62, 0.66, 1.0], dtype=np.float32)
"""Colour of an arm without geometry."""
PATH = np.array([0.1, 0.35, 0.75, 1.0], dtype=np.float32)
"""Colour of a path and its goals."""
ARROW, CAPSULE = mujoco.mjtGeom.mjGEOM_ARROW, mujoco.mjtGeom.mjGEOM_CAPSULE
SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE
HEADLESS = ("egl", "osmesa")  # backends of OpenGL without a display, the first one first
_AROUND = """
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".93 .95 .98" rgb2=".62 .72 .84"
             width="256" height="1536"/>
    <texture name="floor" type="2d" builtin="checker" rgb1=".86 .86 .86" rgb2=".74 .74 .74"
             width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="4 4" texuniform="true"/>
  </asset>
  <worldbody>
    <light type="directional" castshadow="false" pos="1 -1 3" dir="-.3 .4 -.9" diffuse=".5 .5 .5"/>
    <geom type="plane" size="0 0 .05" material="floor" contype="0" conaffinity="0"/>
  </worldbody>
</mujoco>
"""
# what follows is assumed: chosen by eye
_RING = 36  # number of segments of the ring about a joint
_SIZE = 0.25  # radius of the ring over the extent of the arm, at most 1 m [-]


def scene_model(arm: Arm, width: int, height: int) -> mujoco.MjModel:
    """Return the rigid arm on a floor under a sky; its joints are those of the arm, in order.

    Pictures of it have ``width`` and ``height`` [pixel].
    """
    spec = arm.spec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.42] * 3, [0.2] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.visual.map.znear, spec.visual.map.zfar = 0.1, 60.0
    spec.stat.extent = 1.0
    for light in spec.lights:
        spec.delete(light)
    ground = min(0.0, float(arm.model().body_pos[1, 2])) - 1e-3
    at, around = spec.worldbody.add_frame(pos=[0, 0, ground]), mujoco.MjSpec.from_string(_AROUND)
    spec.attach(around, frame=at, prefix="stiction_")
    return spec.compile()


class ArmScene:
    """Pictures of a posed arm; OpenGL is not touched before the first one."""

    def __init__(self, arm: Arm, width: int = 640, height: int = 480) -> None:
        """Prepare pictures of ``width`` and ``height`` [pixel]."""
        self.arm = arm
        self.model = scene_model(arm, width, height)
        self.data = mujoco.MjData(self.model)
        self.joints = [self.model.joint(name).id for name in arm.joint_names]
        self._scene = mujoco.MjvScene(self.model, 2000)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._opened: tuple[mujoco.GLContext, mujoco.MjrContext] | None = None

    def pose(self, q: Array) -> None:
        """Put the arm at joint angles (n,) [rad]."""
        self.data.qpos[self.model.jnt_qposadr[self.joints]] = q
        mujoco.mj_forward(self.model, self.data)

    @property
    def chain(self) -> Array:
        """(n + 1, 3) points of the joints and the flange [m]."""
        flange = self.data.site(self.arm.end_effector).xpos
        return np.vstack([self.data.xanchor[self.joints], flange])

    def camera(self, *more: Array) -> mujoco.MjvCamera:
        """Return a camera that has the arm and ``more`` points (K, 3) [m] in view.

        The camera is on the side to which the arm points, so that the arm does not hide itself.
        """
        chain, base = self.chain, self.data.xpos[self.model.jnt_bodyid[self.joints[0]]] * [1, 1, 0]
        points = np.vstack([*more, chain, base])
        low, high = points.min(axis=0), points.max(axis=0)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        camera.lookat = (low + high) / 2
        radius = float(np.linalg.norm(high - low)) / 2 + 0.12
        camera.distance = radius / np.sin(np.deg2rad(self.model.vis.global_.fovy / 2))
        out = (chain[-1] - base)[:2]
        heading = np.rad2deg(np.arctan2(out[1], out[0])) if np.hypot(*out) > 0.05 else 0.0
        camera.azimuth, camera.elevation = heading + 120.0, -18.0
        return camera

    def picture(
        self, camera: mujoco.MjvCamera, decorate: Callable[[mujoco.MjvScene], None]
    ) -> Frame:
        """Return the picture, (height, width, 3); ``decorate`` may draw into the scene.

        Raises:
            StictionError: no OpenGL.
        """
        self._opened = gl, context = self._opened or _open(self.model)
        shown, nobody = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjvPerturb()
        mujoco.mjv_updateScene(
            *(self.model, self.data, mujoco.MjvOption(), nobody, camera, shown, self._scene)
        )
        decorate(self._scene)
        gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, context)
        out = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(out, None, self._rect, context)
        return np.ascontiguousarray(np.flipud(out))

    def draw_chain(self, scene: mujoco.MjvScene) -> None:
        """Show an arm without geometry by a chain through its joints."""
        if self.model.ngeom == 1:
            polyline(scene, 0.03, self.chain, GREY)  # radius of the chain [m]

    def close(self) -> None:
        """Free the graphics context."""
        if self._opened is not None:
            gl, context = self._opened
            gl.make_current()
            context.free()
            gl.free()
            self._opened = None


def _open(model: mujoco.MjModel) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
    """Open OpenGL for offscreen pictures; without display and MUJOCO_GL, a headless backend."""
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    reasons = []
    for name in HEADLESS if not has_display() and not chosen else [chosen]:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the reason is in the error below
                room = import_module(f"mujoco.{name}") if name in HEADLESS else mujoco
                gl = room.GLContext(model.vis.global_.offwidth, model.vis.global_.offheight)
                gl.make_current()
            context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
            return gl, context
        except Exception as error:  # each backend fails in its own way
            reasons.append(f"{name or 'default'}: {one_line(error)}")
    raise StictionError(
        f"rendering needs OpenGL, and none was found ({'; '.join(reasons)}): install EGL or OSMesa "
        "and set MUJOCO_GL to egl or osmesa"
    )


def draw_shape(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    radius: float,
    at: Array,
    end: Array | None = None,
    colour: Colour = MARK,
) -> None:
    """Add a sphere at a point, or a capsule or an arrow to ``end`` [m], if the scene has room."""
    if scene.ngeom >= scene.maxgeom or (end is not None and np.linalg.norm(end - at) < 1e-6):
        return
    geom, turn = scene.geoms[scene.ngeom], np.eye(3).ravel()
    scene.ngeom += 1
    mujoco.mjv_initGeom(geom, kind, np.full(3, radius), at, turn, colour)
    if end is not None:
        mujoco.mjv_connector(geom, kind, radius, at, end)
    geom.category, geom.emission = mujoco.mjtCatBit.mjCAT_DECOR, 0.5


def polyline(scene: mujoco.MjvScene, width: float, points: Array, colour: Colour = MARK) -> None:
    """Add capsules through points (K, 3) [m] to the scene."""
    for start, end in pairwise(points):
        draw_shape(scene, CAPSULE, width, start, end, colour)


def draw_joint(
    scene: mujoco.MjvScene, arm: ArmScene, joint: int, angle: float, threshold: float
) -> None:
    """Draw a ring about the axis of a joint (from 0), with an arrow along its push and a pointer.

    ``angle`` is the joint's since it rested, ``threshold`` that of breakaway, signed [rad].
    """
    arm.draw_chain(scene)
    index = arm.joints[joint]
    centre, axis = arm.data.xanchor[index], arm.data.xaxis[index]
    first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    radius = _SIZE * max(0.3, min(1.0, float(np.ptp(arm.chain, axis=0).max())))

    def at(turn: float, share: float = 1.0) -> Array:
        out: Array = centre + share * radius * (np.cos(turn) * first + np.sin(turn) * second)
        return out

    side = float(np.sign(threshold))
    turns = side * np.linspace(0, 1.75 * np.pi, _RING)
    polyline(scene, 0.06 * radius, np.array([at(turn) for turn in turns]))
    tangent = side * (np.cos(turns[-1]) * second - np.sin(turns[-1]) * first)
    draw_shape(scene, ARROW, 0.12 * radius, at(turns[-1]), at(turns[-1]) + 0.45 * radius * tangent)
    ends = centre - 1.3 * radius * axis, centre + 1.3 * radius * axis
    draw_shape(scene, CAPSULE, 0.03 * radius, *ends)
    for turn in (0.0, threshold):
        draw_shape(scene, CAPSULE, 0.03 * radius, centre, at(turn, 1.6), PATH)
    draw_shape(scene, CAPSULE, 0.05 * radius, centre, at(angle, 1.6))
    draw_shape(scene, SPHERE, 0.12 * radius, at(angle, 1.6))
