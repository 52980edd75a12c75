"""An arm's links for viewers in 3-D: their shapes, and where they are along a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from stiction_envs.robots import Arm

Array = NDArray[np.float64]
SHOWN = 3
"""Number of geom groups that MuJoCo's viewer shows at first [-]."""
FACES = 20_000
"""Most triangles of an arm; of one with more the meshes' convex hulls are drawn [-]; assumed."""
GRID = 40
"""Steps along the longest side of a mesh to which the corners of its hull are rounded [-];
assumed."""
WIDTH = 0.025
"""Radius of that chain over the arm's length [-]; assumed."""
KINDS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """A solid that is fixed to a link."""

    link: int
    """Number of the body."""
    kind: str
    """``ellipsoid``, ``capsule``, ``cylinder``, ``box`` or ``mesh``."""
    place: Array
    """(3,) its centre in the link's frame [m]."""
    turn: Array
    """(4,) its quaternion there, w x y z."""
    size: Array
    """(3,) half axes; of capsules and cylinders (along z) radius and half length [m]."""
    vertices: NDArray[np.float32] | None = None
    """(V, 3) of a mesh [m]."""
    faces: NDArray[np.int32] | None = None
    """(F, 3) of a mesh."""


def shapes(model: mujoco.MjModel) -> list[Shape]:
    """Return what MuJoCo's viewer shows of an arm, where that is nothing a chain.

    Geoms that only collide are left out of links that have others.
    """
    shown = [g for g in range(model.ngeom) if model.geom_group[g] < SHOWN]
    shown = [g for g in shown if int(model.geom_type[g]) in map(int, KINDS)]
    seen = [g for g in shown if model.geom_contype[g] == model.geom_conaffinity[g] == 0]
    with_seen = {int(model.geom_bodyid[g]) for g in seen}
    out = [_shape(model, g) for g in shown if g in seen or model.geom_bodyid[g] not in with_seen]
    if sum(0 if x.faces is None else len(x.faces) for x in out) > FACES:
        out = [y for x in out if (y := _simple(x)) is not None]
    return out or _chain(model)


def body_poses(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Return (T, B, 3) places [m] and (T, B, 4) quaternions, w x y z, of all bodies at (T, n)."""
    model = arm.model()
    data = mujoco.MjData(model)
    places = np.empty((len(q), model.nbody, 3))
    turns = np.empty((len(q), model.nbody, 4))
    for k, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        places[k], turns[k] = data.xpos, data.xquat
    return places, turns


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    kind = KINDS[mujoco.mjtGeom(int(model.geom_type[geom]))]
    size = model.geom_size[geom].copy()
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
        size[:] = size[0]
    vertices = faces = None
    if kind == "mesh":
        mesh = model.mesh(model.geom_dataid[geom])
        corner, face = mesh.vertadr[0], mesh.faceadr[0]
        vertices = model.mesh_vert[corner : corner + mesh.vertnum[0]].copy()
        faces = model.mesh_face[face : face + mesh.facenum[0]].copy()
    return Shape(
        link=int(model.geom_bodyid[geom]),
        kind=kind,
        place=model.geom_pos[geom].copy(),
        turn=model.geom_quat[geom].copy(),
        size=size,
        vertices=vertices,
        faces=faces,
    )


def _simple(shape: Shape) -> Shape | None:
    """Return a shape whose mesh is replaced by a convex hull; none of a mesh that is flat."""
    if shape.vertices is None:
        return shape
    step = float(np.ptp(shape.vertices, axis=0).max()) / GRID
    points = np.unique(np.round(shape.vertices / step), axis=0)
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    corners = points[hull.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.sum(normal * hull.equations[:, :3], axis=1) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    kept, faces = np.unique(faces, return_inverse=True)
    vertices = (step * points[kept]).astype(np.float32)
    return replace(shape, vertices=vertices, faces=faces.reshape(-1, 3).astype(np.int32))


def _chain(model: mujoco.MjModel) -> list[Shape]:
    """Return capsules from each link's frame to those of its children and its sites."""
    ends = [(int(model.body_parentid[b]), model.body_pos[b]) for b in range(1, model.nbody)]
    ends += [(int(model.site_bodyid[k]), model.site_pos[k]) for k in range(model.nsite)]
    length = float(sum(np.linalg.norm(end) for _, end in ends))
    out = []
    for link, end in ends:
        half = 0.5 * float(np.linalg.norm(end))
        if half == 0:
            continue
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, end / (2 * half))
        size = np.array([WIDTH * length, half, 0.0])
        out.append(Shape(link=link, kind="capsule", place=0.5 * end, turn=turn, size=size))
    return out
