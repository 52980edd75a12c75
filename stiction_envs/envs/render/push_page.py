"""A page in a browser that shows a sticking arm as MuJoCo's viewer does, where there is no display.

Viser serves the page with its client, so that no network is needed. Its buttons and hotkeys stand
for the window's keys.
"""

from __future__ import annotations

import contextlib
import functools
import io
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.render.push_view import DOWN, ONE, SPACE, UP, PushView, R
from stiction_envs.errors import StictionError, missing_extra

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
"""Only this machine may open the page, since it pushes joints."""
# what follows is assumed, but for the groups and sRGB
_PERIOD = 1 / 30  # from one picture to the next [s]
_PANEL_PERIOD = 0.1  # from one panel to the next [s]
_FARTHER, _ASIDE = 1.3, 0.12  # as of `window`: the panel covers the right of the scene [-]
_MARKS = 200  # most shapes that are drawn about the arm
_SHOWN = 3  # number of geom groups that MuJoCo's viewer shows at first
_GAMMA = 2.2  # of sRGB, nearly (IEC 61966-2-1) [-]
_UP = (0.0, 0.0, 1.0)


class PushPage:
    """The page; it runs in real time if the machine is fast enough."""

    def __init__(self, view: PushView, port: int) -> None:
        """Serve it.

        Args:
            view: the arm and its controls.
            port: of this machine; 0 for any that is free.

        Raises:
            StictionError: without viser, or a port that cannot be used.
        """
        try:
            import viser
        except ImportError:
            raise missing_extra("view: a page", "viser", "web") from None
        _check_port(port)
        self.view = view
        self._marks = mujoco.MjvScene(view.model, _MARKS)
        self._lines: dict[float, viser.LineSegmentsHandle] = {}  # by their width
        self._open, self._panel_due = True, 0.0
        with _silence():
            self._server = viser.ViserServer(host=HOST, port=port, verbose=False)
        self.url = f"http://localhost:{self._server.get_port()}"
        self._add_scene()
        self._add_controls()
        self._draw()

    # ---- scene -------------------------------------------------------------------------------

    def _add_scene(self) -> None:
        model, page = self.view.model, self._server.scene
        page.set_up_direction("+z")
        self._bodies = [page.add_frame(f"/{b}", show_axes=False) for b in range(model.nbody)]
        for geom in range(model.ngeom):
            if model.geom_group[geom] < _SHOWN:
                _add_geom(page, model, geom)
        ground = self.view.data.geom("stiction_floor").xpos
        page.add_grid("/floor", 6.0, 6.0, position=ground, plane_opacity=0.5, fade_distance=20.0)
        ball = next(iter(self._drawn()[1]))
        self._tip = page.add_icosphere("/tip", ball.size[0], _colour(ball.rgba))
        camera, look = self.view.camera, self._server.initial_camera
        azimuth, elevation = np.deg2rad([camera.azimuth, camera.elevation])
        level = np.cos(elevation)
        view = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        distance = _FARTHER * camera.distance
        at = camera.lookat + _ASIDE * distance * right
        look.up, look.look_at, look.position = _UP, at, at - distance * view
        look.fov = float(np.deg2rad(model.vis.global_.fovy))

    def _drawn(self) -> tuple[dict[float, list[mujoco.MjvGeom]], list[mujoco.MjvGeom]]:
        """Return the shapes that are drawn about the arm: lines by their width, and balls."""
        self.view.draw(self._marks)
        lines: dict[float, list[mujoco.MjvGeom]] = {}
        balls = []
        for geom in self._marks.geoms[: self._marks.ngeom]:
            if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE:
                balls.append(geom)
            else:
                lines.setdefault(round(2 * float(geom.size[0]), 6), []).append(geom)
        return lines, balls

    def _draw(self) -> None:
        page, data = self._server.scene, self.view.data
        lines, balls = self._drawn()
        with self._server.atomic():
            for body, frame in enumerate(self._bodies):
                frame.position, frame.wxyz = data.xpos[body], data.xquat[body]
            self._tip.position = balls[0].pos
            self._tip.scale = float(balls[0].size[0]) / self._tip.radius
            for width in self._lines.keys() - lines.keys():
                self._lines.pop(width).remove()
            for width, geoms in lines.items():
                points = np.array([_ends(geom) for geom in geoms], dtype=np.float32)
                found = self._lines.get(width)
                if found is not None and found.points.shape == points.shape:
                    found.points = points
                    continue
                # viser 1.1 takes the colours of lines as linear, those of shapes as sRGB
                linear = [_colour(geom.rgba**_GAMMA) for geom in geoms]
                colours = np.array([[c, c] for c in linear], dtype=np.uint8)
                self._lines[width] = page.add_line_segments(
                    f"/marks/{width}", points, colours, thickness=width
                )
        if time.monotonic() >= self._panel_due:
            self._panel.image = self.view.panel()
            self._panel_due = time.monotonic() + _PANEL_PERIOD

    # ---- controls ----------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("Push a joint")
        self._panel = gui.add_image(self.view.panel(), format="png")
        # the page calls back in threads of its own
        joints = [c.hotkey for c in self.view.controls if c.hotkey.isdigit()]
        chosen = gui.add_button_group("joint", joints)
        chosen.on_click(lambda event: self.view.keys.put(ONE - 1 + int(event.target.value)))
        step = f"{100 * self.view.push.STEP:.0f} %"
        pushed = gui.add_button_group("push", [f"− {step}", f"+ {step}"])
        pushed.on_click(
            lambda event: self.view.keys.put(UP if event.target.value.startswith("+") else DOWN)
        )
        for control in self.view.controls:
            press = functools.partial(self._press, control.key)
            if control.key in (SPACE, R):
                gui.add_button(control.label).on_click(press)
            hotkey: Any = control.hotkey
            gui.add_command(control.label, hotkey=hotkey).on_trigger(press)

    def _press(self, key: int, _event: object) -> None:
        self.view.keys.put(key)

    # ---- time --------------------------------------------------------------------------------

    def run(self, report: Callable[[str], None]) -> None:
        """Show the arm until Ctrl-C; ``report`` is called with the address and changes of state."""
        report(f"{self.url} shows the arm, until Ctrl-C")
        with contextlib.suppress(KeyboardInterrupt):
            self.view.run(self._draw, report, is_open=lambda: self._open, period=_PERIOD)

    def close(self) -> None:
        """End the server; `run` ends too."""
        self._open = False
        with _silence():
            self._server.stop()


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep viser's messages out of standard output, which may be JSON."""
    return contextlib.redirect_stdout(io.StringIO())


def _check_port(port: int) -> None:
    """Raise a StictionError where a port cannot be used; viser would look for another one."""
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
    except (OSError, OverflowError) as error:
        why = (getattr(error, "strerror", None) or "no such port").lower()
        raise StictionError(
            f"view: port {port}: {why}: expected a free one, such as 8081"
        ) from None


def _add_geom(page: viser.SceneApi, model: mujoco.MjModel, geom: int) -> None:
    """Add one of the arm's geoms to its body's frame on the page."""
    kinds = mujoco.mjtGeom
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom]
    name = f"/{model.geom_bodyid[geom]}/{geom}"
    material = model.geom_matid[geom]
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    place = {"position": model.geom_pos[geom], "wxyz": model.geom_quat[geom]}
    colour = _colour(rgba)
    look: dict[str, Any] = {"opacity": float(rgba[3]) if rgba[3] < 1 else None, **place}
    if kind == kinds.mjGEOM_BOX:
        page.add_box(name, colour, tuple(2 * size), **look)
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        axes = size if kind == kinds.mjGEOM_ELLIPSOID else np.full(3, size[0])
        page.add_icosphere(name, 1.0, colour, scale=tuple(axes), **look)
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        page.add_cylinder(name, size[0], 2 * size[1], colour, **look)
        if kind == kinds.mjGEOM_CAPSULE:
            for end in (-1.0, 1.0):  # in the cylinder's own frame
                where = (0.0, 0.0, end * size[1])
                page.add_icosphere(f"{name}/{end:+.0f}", size[0], colour, position=where)
    elif kind == kinds.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        corner, face = mesh.vertadr[0], mesh.faceadr[0]
        page.add_mesh_simple(
            name,
            model.mesh_vert[corner : corner + mesh.vertnum[0]],
            model.mesh_face[face : face + mesh.facenum[0]],
            color=colour,
            flat_shading=True,
            **look,
        )


def _colour(rgba: NDArray[np.floating]) -> tuple[int, int, int]:
    red, green, blue = (int(x) for x in np.clip(255 * np.asarray(rgba[:3]), 0, 255).round())
    return red, green, blue


def _ends(geom: mujoco.MjvGeom) -> NDArray[np.float64]:
    """Return the ends (2, 3) of a capsule [m]."""
    half = geom.size[2] * geom.mat[:, 2]
    return np.array([geom.pos - half, geom.pos + half])
