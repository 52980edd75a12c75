"""An arm on a floor, and shapes drawn into its scene."""

from __future__ import annotations

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

Colour = NDArray[np.float32]
MARK = np.array([1.0, 0.45, 0.0, 1.0], dtype=np.float32)
"""Colour of the joint under test, and of the present goal."""
GREY = np.array([0.6, 0.62, 0.66, 1.0], dtype=np.float32)
"""Colour of an arm without geometry."""
PATH = np.array([0.1, 0.35, 0.75, 1.0], dtype=np.float32)
"""Colour of a path and its goals."""


def scene_model(arm: Arm, width: int, height: int) -> mujoco.MjModel:
    """Return the rigid arm on a floor under a sky; its joints are those of the arm, in order.

    Pictures of it have ``width`` and ``height`` [pixel].
    """
    spec = arm.spec()
    bare = spec.compile()
    data = mujoco.MjData(bare)
    data.qpos[:] = arm.rest
    mujoco.mj_forward(bare, data)
    world = spec.worldbody
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.headlight.ambient = [0.42] * 3
    spec.visual.headlight.diffuse = [0.2] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.visual.quality.shadowsize = 2048
    spec.visual.map.shadowclip = 5.0
    spec.visual.map.znear, spec.visual.map.zfar = 0.1, 60.0
    spec.stat.extent = 1.0
    sky = spec.add_texture(name="stiction_sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2, sky.width, sky.height = [0.93, 0.95, 0.98], [0.62, 0.72, 0.84], 256, 1536
    tiles = spec.add_texture(name="stiction_tiles", type=mujoco.mjtTexture.mjTEXTURE_2D)
    tiles.builtin = mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    tiles.rgb1, tiles.rgb2, tiles.width, tiles.height = [0.86] * 3, [0.74] * 3, 256, 256
    floor = spec.add_material(name="stiction_floor", texrepeat=[4, 4], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "stiction_tiles"
    world.add_geom(
        name="stiction_floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        pos=[0, 0, float(min(0.0, data.xpos[1, 2])) - 1e-3],
        material="stiction_floor",
        contype=0,
        conaffinity=0,
    )
    for light in spec.lights:
        spec.delete(light)
    world.add_light(
        pos=[1, -1, 3],
        dir=[-0.3, 0.4, -0.9],
        diffuse=[0.5] * 3,
        specular=[0.1] * 3,
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
    )
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
        self._option = mujoco.MjvOption()
        self._screen: Offscreen | None = None

    def pose(self, q: Array) -> None:
        """Put the arm at joint angles (n,) [rad]."""
        self.data.qpos[self.model.jnt_qposadr[self.joints]] = q
        mujoco.mj_forward(self.model, self.data)

    @property
    def flange(self) -> Array:
        """(3,) position of the flange [m]."""
        return np.array(self.data.site(self.arm.end_effector).xpos)

    @property
    def points(self) -> Array:
        """(K, 3) points of the arm [m]: its joints, last flange and base."""
        base = self.data.xpos[self.model.jnt_bodyid[self.joints[0]]] * [1, 1, 0]
        return np.vstack([self.data.xanchor[self.joints], self.flange[None], base[None]])

    def camera(self, points: Array) -> mujoco.MjvCamera:
        """Return a camera that has all points (K, 3) [m], the last two flange and base, in view.

        It stands on the side to which the arm points, so that the arm does not hide itself.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        camera.lookat = (low + high) / 2
        camera.distance = self.distance(float(np.linalg.norm(high - low)) / 2 + 0.12)
        out = points[-2, :2] - points[-1, :2]
        heading = np.rad2deg(np.arctan2(out[1], out[0])) if np.hypot(*out) > 0.05 else 0.0
        camera.azimuth, camera.elevation = heading + 120.0, -18.0
        return camera

    def distance(self, radius: float) -> float:
        """Return the distance [m] at which a sphere of a radius [m] fills the camera's picture."""
        return radius / float(np.sin(np.deg2rad(self.model.vis.global_.fovy / 2)))

    def picture(
        self, camera: mujoco.MjvCamera, decorate: Callable[[mujoco.MjvScene], None]
    ) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3); ``decorate`` may draw into the scene."""
        self._screen = self._screen or Offscreen(self.model)
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._option,
            mujoco.MjvPerturb(),
            camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        decorate(self._scene)
        return self._screen.picture(self._scene)

    def draw_chain(self, scene: mujoco.MjvScene) -> None:
        """Show an arm without geometry by a chain through its joints."""
        if self.model.ngeom == 1:
            chain = np.vstack([self.data.xanchor[self.joints], self.flange])
            polyline(scene, 0.03, chain, GREY)  # radius of the chain [m]

    def close(self) -> None:
        """Free the graphics context."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None


def connect(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    width: float,
    start: Array,
    end: Array,
    colour: Colour = MARK,
) -> None:
    """Add a capsule or an arrow from ``start`` to ``end`` [m] to the scene."""
    if np.linalg.norm(end - start) > 1e-6 and (geom := _new_geom(scene)) is not None:
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), colour)
        mujoco.mjv_connector(geom, kind, width, start, end)
        geom.category, geom.emission = mujoco.mjtCatBit.mjCAT_DECOR, 0.5


def polyline(scene: mujoco.MjvScene, width: float, points: Array, colour: Colour = MARK) -> None:
    """Add capsules through points (K, 3) [m] to the scene."""
    for start, end in pairwise(points):
        connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, width, start, end, colour)


def ball(scene: mujoco.MjvScene, radius: float, at: Array, colour: Colour) -> None:
    """Add a sphere of a radius [m] at (3,) [m] to the scene."""
    if (geom := _new_geom(scene)) is not None:
        size, turn = np.full(3, radius), np.eye(3).ravel()
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, at, turn, colour)
        geom.category, geom.emission = mujoco.mjtCatBit.mjCAT_DECOR, 0.5


def _new_geom(scene: mujoco.MjvScene) -> mujoco.MjvGeom | None:
    """Return the next geom of a scene; None where it is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    scene.ngeom += 1
    return scene.geoms[scene.ngeom - 1]


def _context_class(name: str) -> type[mujoco.GLContext]:
    if name in ("egl", "osmesa"):
        return import_module(f"mujoco.{name}").GLContext
    return mujoco.GLContext


class Offscreen:
    """An offscreen OpenGL buffer, as large as the model says (``vis.global_.offwidth``)."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Open the buffer.

        Raises:
            StictionError: no OpenGL.
        """
        self._width, self._height = model.vis.global_.offwidth, model.vis.global_.offheight
        self._gl, self._context = self._open(model)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._rect = mujoco.MjrRect(0, 0, self._width, self._height)

    def _open(self, model: mujoco.MjModel) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
        """Open MuJoCo's context; without display and MUJOCO_GL, the first headless backend."""
        chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
        names = ["egl", "osmesa"] if not has_display() and not chosen else [chosen]
        reasons = []
        for name in names:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the reason is in the error below
                    gl = _context_class(name)(self._width, self._height)
                    gl.make_current()
                return gl, mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            except Exception as error:  # each backend fails in its own way
                reasons.append(f"{name or 'default'}: {one_line(error)}")
        raise StictionError(
            f"rendering needs OpenGL, and none was found ({'; '.join(reasons)}): install EGL or "
            "OSMesa and set MUJOCO_GL to egl or osmesa"
        )

    def picture(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3)."""
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._context)
        out = np.empty((self._height, self._width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(out, None, self._rect, self._context)
        return np.ascontiguousarray(np.flipud(out))

    def close(self) -> None:
        """Free the buffer."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()
