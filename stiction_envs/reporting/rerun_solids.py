"""The solids of a MuJoCo model in a recording of Rerun."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rerun = Any
"""Its objects, and arrays for them: its types are there with the extra only, and refuse some."""
SHOWN = 3
"""Number of geom groups that MuJoCo's viewer shows at first [-]."""
WIDTH = 0.025
"""Radius of the links of an arm without geoms, over its length [-]; assumed."""
Colour = tuple[int, ...]
"""Red, green, blue, and, where it is not all, opacity [0 to 255]."""


def send_arm(
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
