"""A diagnosis as a recording of Rerun: series, contact, evidence and the arm in 3-D."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.gap.report.series import Series
from stiction_envs.reporting.output_folder import check_file

Array = NDArray[np.float64]
Rerun = Any
"""Objects of Rerun, and arrays for them: Rerun's types are there with the extra only."""
SHOWN = 3
"""Number of geom groups that MuJoCo's viewer shows at first [-]."""
WIDTH = 0.025
"""Radius of the links of an arm without geoms, over its length [-]; assumed."""
Colour = tuple[int, ...]
"""Red, green, blue, and, where it is not all, opacity [0 to 255]."""
POSES = 4000
"""Most poses of an arm in 3-D [-]; assumed."""
TIMELINE = "time"
OPACITY = 110
"""Opacity of the simulated arm, which covers the measured one [0 to 255]; assumed."""
BEFORE: Colour = (224, 108, 24)
AFTER: Colour = (70, 140, 220)
MEASURED: Colour = (160, 160, 160)
"""Colours of the report's pictures, lighter, since Rerun's viewer is dark."""
COMMANDED: Colour = (110, 110, 110)
CAUSES: tuple[Colour, ...] = (
    *((214, 39, 140), (44, 160, 44), (188, 189, 34)),
    *((148, 103, 189), (23, 190, 207), (227, 119, 194)),
)
"""Colours of causes, in turn."""


def check_rrd(path: Path, *, force: bool = False, made: Path | None = None) -> None:
    """Raise if a recording cannot be written.

    Args:
        path: the file.
        force: whether it may replace another.
        made: a folder that will be there.

    Raises:
        StictionError: Rerun's SDK is not installed, or the name or place is wrong.
    """
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise missing_extra("writing for Rerun", "rerun-sdk", "rerun") from None
    check_file(path, ".rrd", force=force)
    if not path.parent.is_dir() and (made is None or path.parent.resolve() != made.resolve()):
        raise StictionError(f"output {path}: {path.parent}: expected a folder that is there")


def rrd_bytes(s: Series, words: str) -> bytes:
    """Return the file, with ``words`` in Markdown; starts no viewer and opens no connection."""
    import rerun as rr

    recording = rr.RecordingStream(f"stiction_envs {s.arm.name}", send_properties=False)
    kept = recording.memory_recording()
    for group, drawn in lines(s).items():
        for j in range(s.arm.n):
            alone = {name: (values[:, j], colour) for name, (values, colour) in drawn.items()}
            _send_lines(recording, f"{group}/joint_{j + 1}", s.time, alone)
    if s.contact is not None:
        _send_lines(recording, "contact", s.time, {"contact": (s.contact.astype(float), BEFORE)})
    every = max(1, -(-len(s.time) // POSES))
    parts = [f"# {s.arm.name}", words]
    if s.step > 1:
        parts.append(f"One row of {s.step} is in this file.")
    if every > 1:
        parts.append(f"The arm is drawn at one row of {every} of this file.")
    if s.q_simulated is None:
        parts.append("Torques are simulated along the measured motion: one arm is drawn.")
    document = rr.TextDocument("\n\n".join(parts), media_type="text/markdown")
    recording.log("diagnosis", document, static=True)
    some = slice(None, None, every)
    clock = rr.TimeColumn(TIMELINE, duration=s.time[some])
    model = s.arm.model()
    _send_arm(recording, "arm/measured", model, clock, s.q[some], MEASURED)
    if s.q_simulated is not None:
        simulated = s.q_simulated[some]
        _send_arm(recording, "arm/simulated", model, clock, simulated, (*AFTER, OPACITY))
    recording.send_blueprint(_blueprint(s))
    recording.flush()
    return bytes(kept.drain_as_bytes())


def lines(s: Series) -> dict[str, dict[str, tuple[Array, Colour]]]:
    """Return (T, n) values and colour of each line by name, by group."""
    of = {
        "measured": (s.measured, MEASURED),
        "nominal": (s.nominal, BEFORE),
        "simulated": (s.simulated, AFTER),
    }
    if s.q_cmd is not None:
        of = {"commanded": (s.q_cmd, COMMANDED)} | of
    left = {
        "nominal": (s.measured - s.nominal, BEFORE),
        "simulated": (s.measured - s.simulated, AFTER),
    }
    colours = cycle(CAUSES)
    causes = {name: (torque, next(colours)) for name, torque in s.causes.items()}
    return {s.quantity: of, "residual": left} | ({"cause": causes} if causes else {})


def _send_lines(
    recording: Rerun, path: str, time: Array, drawn: dict[str, tuple[Array, Colour]]
) -> None:
    """Send (T,) values of lines that are drawn together, and how."""
    import rerun as rr

    values = np.stack([x for x, _ in drawn.values()], axis=1)
    look = rr.SeriesLines(colors=[colour for _, colour in drawn.values()], names=list(drawn))
    recording.log(path, look, static=True)
    clock = rr.TimeColumn(TIMELINE, duration=time)
    recording.send_columns(path, [clock], rr.Scalars.columns(scalars=values))


def _blueprint(s: Series) -> Rerun:
    """Return the layout of the viewer: arm and words beside a tab for each joint."""
    import rerun.blueprint as rrb

    def joint(j: int) -> Rerun:
        of = f"joint_{j + 1}"
        groups = [(s.quantity, f"{s.quantity} [{s.unit}]"), ("residual", f"residual [{s.unit}]")]
        if s.causes:
            groups.append(("cause", "torque of each cause [N·m]"))
        views = [rrb.TimeSeriesView(origin=f"{g}/{of}", name=title) for g, title in groups]
        if s.contact is not None and s.contact.any():
            views.append(rrb.TimeSeriesView(origin="contact", name="touches something"))
        return rrb.Vertical(*views, name=f"joint {j + 1}")

    left = rrb.Vertical(
        rrb.Spatial3DView(origin="arm", name="arm"),
        rrb.TextDocumentView(origin="diagnosis", name="diagnosis"),
    )
    joints = rrb.Tabs(*(joint(j) for j in range(s.arm.n)))
    return rrb.Blueprint(rrb.Horizontal(left, joints), auto_views=False)


# ---- the arm ----


def _send_arm(
    recording: Rerun,
    path: str,
    model: mujoco.MjModel,
    time: Rerun,
    q: Array,
    colour: Colour,
) -> None:
    """Send the solids of a model's bodies, and where they are over time.

    Args:
        recording: Rerun's stream.
        path: entity of the arm.
        model: of the arm.
        time: column of (T,) times.
        q: (T, n) joint angles [rad].
        colour: of all solids.
    """
    import rerun as rr

    places, turns = body_poses(model, q)
    links = [f"{path}/{model.body(b).name or b}" for b in range(model.nbody)]
    solids = _geoms(model, colour) or _chain(model, colour)
    for b in sorted({link for link, _ in solids} - {0}):
        columns = rr.Transform3D.columns(
            translation=places[:, b], quaternion=np.roll(turns[:, b], -1, axis=-1)
        )
        recording.send_columns(links[b], [time], columns)
    for k, (link, drawn) in enumerate(solids):
        recording.log(f"{links[link]}/shape_{k}", *drawn, static=True)


def body_poses(model: mujoco.MjModel, q: Array) -> tuple[Array, Array]:
    """Return (T, B, 3) places [m] and (T, B, 4) quaternions, w x y z, of all bodies at (T, n)."""
    data = mujoco.MjData(model)
    places, turns = np.empty((len(q), model.nbody, 3)), np.empty((len(q), model.nbody, 4))
    for k, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        places[k], turns[k] = data.xpos, data.xquat
    return places, turns


def _geoms(model: mujoco.MjModel, colour: Colour) -> list[tuple[int, list[Rerun]]]:
    """Return link and solid of each geom that MuJoCo's viewer shows.

    Geoms that only collide are left out of links that have others.
    """
    shown = [g for g in range(model.ngeom) if model.geom_group[g] < SHOWN]
    seen = [g for g in shown if model.geom_contype[g] == model.geom_conaffinity[g] == 0]
    with_seen = {int(model.geom_bodyid[g]) for g in seen}
    drawn = [g for g in shown if g in seen or model.geom_bodyid[g] not in with_seen]
    solids = ((int(model.geom_bodyid[g]), _geom(model, g, colour)) for g in drawn)
    return [(link, solid) for link, solid in solids if solid]


def _geom(model: mujoco.MjModel, g: int, colour: Colour) -> list[Rerun]:
    """Return how Rerun draws a geom; nothing of planes and the like."""
    import rerun as rr

    kind, size = mujoco.mjtGeom(int(model.geom_type[g])), model.geom_size[g]
    place, quaternion = model.geom_pos[g], model.geom_quat[g]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[g])
        corner, face = mesh.vertadr[0], mesh.faceadr[0]
        vertices = model.mesh_vert[corner : corner + mesh.vertnum[0]]
        corners: Rerun = vertices[model.mesh_face[face : face + mesh.facenum[0]]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        normals: Rerun = np.repeat(across, 3, axis=0)  # without them a mesh has no shade
        where = rr.Transform3D(translation=place, quaternion=np.roll(quaternion, -1))
        solid = rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3), vertex_normals=normals, albedo_factor=colour
        )
        return [where, solid]
    look = _look(quaternion, colour) | {"centers": [place]}
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return [rr.Boxes3D(half_sizes=[size], **look)]
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        sphere = kind == mujoco.mjtGeom.mjGEOM_SPHERE
        return [rr.Ellipsoids3D(half_sizes=[np.full(3, size[0]) if sphere else size], **look)]
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return [rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], **look)]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return [_capsule(place, quaternion, float(size[0]), float(size[1]), colour)]
    return []


def _look(quaternion: Array, colour: Colour) -> dict[str, Rerun]:
    fill = "solid" if len(colour) == 3 else "transparentfillmajorwireframe"
    return {"colors": [colour], "quaternions": [np.roll(quaternion, -1)], "fill_mode": fill}


def _capsule(place: Array, quaternion: Array, radius: float, half: float, colour: Colour) -> Rerun:
    """Return a capsule about a place; those of Rerun begin where they are placed."""
    import rerun as rr

    axis = np.empty(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, half]), quaternion)
    look = _look(quaternion, colour)
    return rr.Capsules3D(lengths=[2 * half], radii=[radius], translations=[place - axis], **look)


def _chain(model: mujoco.MjModel, colour: Colour) -> list[tuple[int, list[Rerun]]]:
    """Return capsules from each link's frame to those of its children and its sites."""
    ends = [(int(model.body_parentid[b]), model.body_pos[b]) for b in range(1, model.nbody)]
    ends += [(int(model.site_bodyid[k]), model.site_pos[k]) for k in range(model.nsite)]
    ends = [(link, end) for link, end in ends if end.any()]
    radius = WIDTH * float(sum(np.linalg.norm(end) for _, end in ends))
    out = []
    for link, end in ends:
        half, quaternion = 0.5 * float(np.linalg.norm(end)), np.empty(4)
        mujoco.mju_quatZ2Vec(quaternion, end / (2 * half))
        out.append((link, [_capsule(0.5 * end, quaternion, radius, half, colour)]))
    return out
