"""An offscreen OpenGL buffer: made at the first picture, without OpenGL only drawing fails."""

from __future__ import annotations

import os
import warnings
from importlib import import_module

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.window import has_display
from stiction_envs.errors import StictionError, one_line


def _context_class(name: str) -> type[mujoco.GLContext]:
    if name in ("egl", "osmesa"):
        return import_module(f"mujoco.{name}").GLContext
    return mujoco.GLContext


class Offscreen:
    """An offscreen OpenGL buffer, as large as the model says (``vis.global_.offwidth``)."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Open it.

        Raises:
            StictionError: no OpenGL.
        """
        self._model = model
        self._width, self._height = model.vis.global_.offwidth, model.vis.global_.offheight
        self._gl, self._context = self._open(model)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZERONEAR.value
        self._rect = mujoco.MjrRect(0, 0, self._width, self._height)

    def _open(self, model: mujoco.MjModel) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
        """Open MuJoCo's context; without display and MUJOCO_GL, whatever renders headless."""
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

    def _draw(self, scene: mujoco.MjvScene) -> None:
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._context)

    def colour(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3)."""
        self._draw(scene)
        out = np.empty((self._height, self._width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(out, None, self._rect, self._context)
        return np.ascontiguousarray(np.flipud(out))

    def depth(self, scene: mujoco.MjvScene) -> NDArray[np.float32]:
        """Return the distance along the view [m], (height, width)."""
        self._draw(scene)
        out = np.empty((self._height, self._width), dtype=np.float32)
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
