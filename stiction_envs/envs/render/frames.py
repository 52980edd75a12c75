"""Frames of the environments: the arm in a scene, a panel of plots next to it.

What is drawn into it is the environments' own: `frames_sje.py`, `frames_gte.py`.

The graphics context is made at the first frame; without OpenGL only rendering fails.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from abc import ABC, abstractmethod
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, unknown
from stiction_envs.robots import Arm

if TYPE_CHECKING:
    from stiction_envs.envs.batch_core import BatchCore

Array = NDArray[np.float64]
RENDER_MODES = ("human", "rgb_array", "depth_array")
SCENE_WIDTH, HEIGHT, PANEL_WIDTH = 460, 450, 340
"""Size of the scene and of the panel next to it [pixel]."""
MARK = np.array([1.0, 0.45, 0.0, 1.0], dtype=np.float32)
"""Colour of what an episode is about: the joint under test, the goal."""
GREY = np.array([0.6, 0.62, 0.66, 1.0], dtype=np.float32)
"""Colour of an arm without geometry."""
_FARTHER, _ASIDE = 1.3, 0.2  # of the window: its panel is drawn over the scene


def check_render_mode(mode: str | None, *, batch: bool = False) -> None:
    """Raise a StictionError for a mode that does not exist, or not for a batch."""
    expected = [m for m in RENDER_MODES if not (batch and m == "human")]
    if mode is not None and mode not in expected:
        raise unknown("render mode", mode, expected)


def scene_model(arm: Arm) -> mujoco.MjModel:
    """Return the rigid arm on a floor under a sky; its joints are those of the arm, in order."""
    spec = arm.spec()
    bare = spec.compile()
    data = mujoco.MjData(bare)
    data.qpos[:] = arm.rest
    mujoco.mj_forward(bare, data)
    world = spec.worldbody
    spec.visual.global_.offwidth, spec.visual.global_.offheight = SCENE_WIDTH, HEIGHT
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


class Renderer(ABC):
    """Draws the simulations of one environment; made lazily, closed by the environment."""

    def __init__(self, core: BatchCore) -> None:
        """Prepare the scene; OpenGL is not touched yet."""
        self._core = core
        self._model = scene_model(core.arm)
        self._data = mujoco.MjData(self._model)
        self._joints = [self._model.joint(name).id for name in core.arm.joint_names]
        self._scene = mujoco.MjvScene(self._model, 2000)
        self._option = mujoco.MjvOption()
        self._screen: _Screen | None = None
        self._viewer: Any = None
        self._threads: list[threading.Thread] = []
        self._shown = 0.0

    def frame(self, i: int, mode: str) -> Any:
        """Return the frame of simulation ``i``; in human mode show it and return None."""
        self._pose(i)
        if mode == "human":
            self._show(i)
            return None
        if self._screen is None:
            self._screen = _Screen(self._model)
        camera = self._camera(i)
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            self._option,
            mujoco.MjvPerturb(),
            camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        if mode == "depth_array":
            return self._screen.depth(self._scene)
        self._decorate(self._scene, i)
        picture = self._screen.colour(self._scene)
        return np.concatenate([picture, self._panel(i)], axis=1)

    @abstractmethod
    def _decorate(self, scene: mujoco.MjvScene, i: int) -> None:
        """Draw what the arm is about into the scene."""

    @abstractmethod
    def _panel(self, i: int) -> NDArray[np.uint8]:
        """Return the panel of simulation ``i``, (HEIGHT, PANEL_WIDTH, 3)."""

    @abstractmethod
    def _words(self, i: int) -> tuple[str, str]:
        """Return names and values, in lines, of what simulation ``i`` is doing."""

    def _pose(self, i: int) -> None:
        addresses = self._model.jnt_qposadr[self._joints]
        self._data.qpos[addresses] = self._core.rig.plant.position[i]
        mujoco.mj_forward(self._model, self._data)

    def _points(self, i: int) -> Array:
        """Return (K, 3) points [m] that must be in the frame: joints, last flange and base."""
        flange = self._data.site(self._core.arm.end_effector).xpos
        base = self._data.xpos[self._model.jnt_bodyid[self._joints[0]]] * [1, 1, 0]
        return np.vstack([self._data.xanchor[self._joints], flange[None], base[None]])

    def _camera(self, i: int) -> mujoco.MjvCamera:
        points = self._points(i)
        low, high = points.min(axis=0), points.max(axis=0)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        camera.lookat = (low + high) / 2
        radius = float(np.linalg.norm(high - low)) / 2 + 0.12
        camera.distance = radius / np.sin(np.deg2rad(self._model.vis.global_.fovy / 2))
        # from the side to which the arm points, so that it does not hide itself
        out = points[-2, :2] - points[-1, :2]
        heading = np.rad2deg(np.arctan2(out[1], out[0])) if np.hypot(*out) > 0.05 else 0.0
        camera.azimuth, camera.elevation = heading + 120.0, -18.0
        return camera

    def _draw_chain(self, scene: mujoco.MjvScene, width: float) -> None:
        """Show an arm without geometry by a chain through its joints, ``width`` in m."""
        if self._model.ngeom > 1:
            return
        points = self._data.xanchor[self._joints]
        chain = [*points, self._data.site(self._core.arm.end_effector).xpos]
        for a, b in pairwise(chain):
            connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, width, a, b, GREY)

    def _show(self, i: int) -> None:
        if self._viewer is None:
            before = set(threading.enumerate())
            self._viewer = _open_viewer(self._model, self._data)
            self._threads = [t for t in threading.enumerate() if t not in before]
            camera = self._camera(i)
            heading = np.deg2rad(camera.azimuth)
            right = np.array([np.sin(heading), -np.cos(heading), 0.0])
            # room for the panel on the left
            camera.distance *= _FARTHER
            camera.lookat -= _ASIDE * camera.distance * right
            with self._viewer.lock():
                self._viewer.cam.lookat[:] = camera.lookat
                self._viewer.cam.distance = camera.distance
                self._viewer.cam.azimuth, self._viewer.cam.elevation = (
                    camera.azimuth,
                    camera.elevation,
                )
        if not self._viewer.is_running():
            raise StictionError("the window was closed")
        with self._viewer.lock():
            self._viewer.user_scn.ngeom = 0
            self._decorate(self._viewer.user_scn, i)
        # MuJoCo 4.0 draws an image over a textured scene only where a text was drawn before it
        self._viewer.set_texts((None, None, *self._words(i)))
        viewport = mujoco.MjrRect(8, 8, PANEL_WIDTH, HEIGHT)
        self._viewer.set_images((viewport, self._panel(i)))
        self._viewer.sync()
        # real time, as far as the machine is fast enough
        late = time.monotonic() - self._shown
        time.sleep(max(0.0, self._core.interval - late))
        self._shown = time.monotonic()

    def close(self) -> None:
        """Free the graphics context and close the window."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None
        if self._viewer is not None:
            self._viewer.close()
            for thread in self._threads:
                thread.join(timeout=5.0)  # a window that outlives the interpreter crashes it
            self._viewer, self._threads = None, []


def connect(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    width: float,
    start: Array,
    end: Array,
    colour: NDArray[np.float32] = MARK,
) -> None:
    """Add a capsule or an arrow from ``start`` to ``end`` [m] to the scene."""
    if scene.ngeom >= scene.maxgeom or np.linalg.norm(end - start) < 1e-6:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), colour)
    mujoco.mjv_connector(geom, kind, width, start, end)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.emission = 0.5
    scene.ngeom += 1


def ball(scene: mujoco.MjvScene, radius: float, at: Array, colour: NDArray[np.float32]) -> None:
    """Add a sphere of a radius [m] at (3,) [m] to the scene."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    size = np.full(3, radius)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, at, np.eye(3).ravel(), colour)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.emission = 0.5
    scene.ngeom += 1


def has_display() -> bool:
    """Return whether a window can be opened, as far as the environment variables tell."""
    found = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(found) or not sys.platform.startswith("linux")


def _open_viewer(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    if not has_display():
        raise StictionError("render_mode human: no display found: use rgb_array or depth_array")
    try:
        import mujoco.viewer

        return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except Exception as error:  # glfw, OpenGL and macOS each fail in their own way
        raise StictionError(f"render_mode human: no window: {_line(error)}") from None


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _context_class(name: str) -> Any:
    if name == "egl":
        from mujoco.egl import GLContext as Egl

        return Egl
    if name == "osmesa":
        from mujoco.osmesa import GLContext as Osmesa

        return Osmesa
    return mujoco.GLContext


class _Screen:
    """An offscreen OpenGL buffer of the scene's size."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._gl, self._context = self._open(model)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZERONEAR.value
        self._rect = mujoco.MjrRect(0, 0, SCENE_WIDTH, HEIGHT)

    @staticmethod
    def _open(model: mujoco.MjModel) -> tuple[Any, mujoco.MjrContext]:
        """Open MuJoCo's context; without display and MUJOCO_GL, whatever renders headless."""
        chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
        names = ["egl", "osmesa"] if not has_display() and not chosen else [chosen]
        reasons = []
        for name in names:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the reason is in the error below
                    gl = _context_class(name)(SCENE_WIDTH, HEIGHT)
                    gl.make_current()
                return gl, mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            except Exception as error:  # each backend fails in its own way
                reasons.append(f"{name or 'default'}: {_line(error)}")
        raise StictionError(
            f"rendering needs OpenGL, and none was found ({'; '.join(reasons)}): install EGL or "
            "OSMesa and set MUJOCO_GL to egl or osmesa"
        )

    def _draw(self, scene: mujoco.MjvScene) -> None:
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._context)

    def colour(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Return the picture, (HEIGHT, SCENE_WIDTH, 3)."""
        self._draw(scene)
        out = np.empty((HEIGHT, SCENE_WIDTH, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(out, None, self._rect, self._context)
        return np.ascontiguousarray(np.flipud(out))

    def depth(self, scene: mujoco.MjvScene) -> NDArray[np.float32]:
        """Return the distance along the view [m], (HEIGHT, SCENE_WIDTH)."""
        self._draw(scene)
        out = np.empty((HEIGHT, SCENE_WIDTH), dtype=np.float32)
        mujoco.mjr_readPixels(None, out, self._rect, self._context)
        extent = self._model.stat.extent
        near, far = self._model.vis.map.znear * extent, self._model.vis.map.zfar * extent
        metres = near / (1.0 - out.astype(np.float64) * (1.0 - near / far))
        return np.ascontiguousarray(np.flipud(metres)).astype(np.float32)

    def close(self) -> None:
        """Free the buffer."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()
