"""Limits of an excitation: position, speed, acceleration, torque, and distances.

Distances are between the collision geometry of the arm's MJCF, and to a floor at the world's z = 0.
Pairs that touch at rest (a foot on the floor, neighbours) are left out. Pairs that are near at rest
keep half of their distance there. A link may have many shapes (a URDF writes a capsule as a
cylinder and two balls), which makes hundreds of pairs: MuJoCo is called only for those whose
bounding spheres are near.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.identification.excitation_motion import State
from stiction_envs.identification.settings import ExcitationSettings
from stiction_envs.robots import ARMS, Arm
from stiction_envs.robots.arm_toml import lookup, per_joint

NEAR = 0.05
"""Links that are nearer at rest are neighbours: half of their distance there is kept [m]; assumed.
"""
TOUCHING = 1e-3  # pairs that are nearer at rest touch, and are left out [m]; assumed
FLANGE_BALL = 0.05  # radius of the ball in place of an arm without collision geometry [m]; assumed
ROUNDING = 1e-3
"""Distances between bounding spheres count as smaller by this [m]; assumed. It is far above what
MuJoCo rounds, so that a pair left out could not have changed a bit."""
_SOLID = {"contype": 1, "conaffinity": 1}


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionBounds:
    """Margins taken off; (n,) each."""

    low: Array
    """[rad]."""
    high: Array
    """[rad]."""
    velocity: Array
    """[rad/s]."""
    acceleration: Array
    """[rad/s²]."""
    torque: Array
    """[N·m]."""


def acceleration_limits(arm: Arm, free: float) -> tuple[Array, bool]:
    """Return (n,) limits [rad/s²], and whether they are the robot's or assumed."""
    if arm.registered_name is not None:
        found = lookup(ARMS[arm.registered_name].table, "limits.acceleration")
        if found is not None:
            return per_joint(found, (arm.n,), f"{arm.name}.toml, limits.acceleration"), True
    return np.full(arm.n, free), False


def bounds_of(arm: Arm, settings: ExcitationSettings) -> MotionBounds:
    """Return an arm's limits minus the margins."""
    low, high = arm.limits.position.T
    # a range narrower than both margins leaves its middle
    margin = np.minimum(settings.position_margin, 0.45 * (high - low))
    acceleration, _ = acceleration_limits(arm, settings.acceleration_free)
    return MotionBounds(
        low=low + margin,
        high=high - margin,
        velocity=settings.velocity_part * arm.limits.velocity,
        acceleration=settings.acceleration_part * acceleration,
        torque=settings.torque_part * arm.limits.torque,
    )


class Clearance:
    """Distances between an arm's links, and to the floor, by MuJoCo; nothing is stepped."""

    def __init__(self, arm: Arm, settings: ExcitationSettings) -> None:
        """Look for the pairs of geometry that may come close."""
        spec = arm.spec()
        solid = [g for g in spec.geoms if g.contype or g.conaffinity]
        self.own_geometry = bool(solid)
        if not solid:
            flange = next(x for x in spec.sites if x.name == arm.end_effector)
            ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [FLANGE_BALL, 0, 0], "mass": 0}
            flange.parent.add_geom(pos=flange.pos, **ball, **_SOLID)
        floor = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [5, 5, 0.1]}
        spec.worldbody.add_geom(name="excitation_floor", **floor, **_SOLID)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        pairs = self._candidates()
        self._place(arm.rest)
        at_rest = {p: self._distance(*p, 1.0) for p in pairs}
        self.pairs = [p for p, d in at_rest.items() if d > TOUCHING]
        self._one, self._two = np.array(self.pairs, dtype=np.intp).reshape(-1, 2).T
        # neighbours keep half of their distance at rest
        near = [p for p in self.pairs if at_rest[p] < min(NEAR, settings.clearance)]
        self._allowed = {p: settings.clearance - at_rest[p] / 2 for p in near}
        self.notes = [
            f"{self._link(i)} and {self._link(j)} are {1e3 * at_rest[i, j]:.0f} mm apart at rest: "
            "half of that is kept"
            for i, j in self._allowed
        ]

    def _candidates(self) -> list[tuple[int, int]]:
        """Return the pairs of shapes that may touch, but for those of one link or of neighbours."""
        m = self.model
        parent = m.body_weldid[m.body_parentid[m.body_weldid]]
        out = []
        for i, j in combinations(range(m.ngeom), 2):
            low, high = sorted((int(m.geom_bodyid[i]), int(m.geom_bodyid[j])))
            one, two = (int(m.body_weldid[x]) for x in (low, high))
            apart = one != two and not (one and two and (parent[one] == two or parent[two] == one))
            touch = (m.geom_contype[i] & m.geom_conaffinity[j]) | (
                m.geom_contype[j] & m.geom_conaffinity[i]
            )
            if touch and apart and (low << 16) + high not in m.exclude_signature:
                out.append((i, j))
        return out

    def _place(self, q: Array) -> None:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)

    def _distance(self, i: int, j: int, most: float, ends: Array | None = None) -> float:
        return float(mujoco.mj_geomDistance(self.model, self.data, i, j, most, ends))

    def _bounds(self, q: Array) -> Array:
        """Return (T, P) distances of bounding spheres at poses (T, n) [m]: no pair is nearer."""
        m, centre = self.model, np.empty((len(q), self.model.ngeom, 3))
        normal = np.empty_like(centre)
        for k, pose in enumerate(q):
            self._place(pose)
            centre[k] = self.data.geom_xpos
            normal[k] = self.data.geom_xmat[:, 2::3]
        apart = centre[:, self._two] - centre[:, self._one]
        out = np.sqrt(np.einsum("tpx,tpx->tp", apart, apart))
        for plane, sign in ((self._one, 1.0), (self._two, -1.0)):
            flat = m.geom_type[plane] == mujoco.mjtGeom.mjGEOM_PLANE  # endless: no sphere
            out[:, flat] = sign * np.einsum("tpx,tpx->tp", apart, normal[:, plane])[:, flat]
        return np.asarray(out - m.geom_rbound[self._one] - m.geom_rbound[self._two] - ROUNDING)

    def _link(self, geometry: int) -> str:
        return str(self.model.body(int(self.model.geom_bodyid[geometry])).name)

    def _close(
        self, q: Array, most: float, *, nearest_first: bool = False
    ) -> Iterator[tuple[int, tuple[int, int]]]:
        """Yield poses of (T, n), the arm in place, and pairs that may be nearer than this [m]."""
        bounds = self._bounds(q)
        near = bounds < most
        poses = np.flatnonzero(near.any(axis=1))
        if nearest_first:
            poses = np.argsort(bounds.min(axis=1, initial=most))[: len(poses)]
        for k in poses:
            self._place(q[k])
            for p in np.flatnonzero(near[k]):
                yield int(k), self.pairs[p]

    def least(self, q: Array, most: float = 0.5) -> Array:
        """Return (T,) least distance at poses (T, n) [m], at most ``most``."""
        out = np.full(len(q), most)
        for k, pair in self._close(q, most):
            out[k] = min(out[k], self._distance(*pair, most))
        return out

    def keeps(self, q: Array, wanted: float) -> bool:
        """Return whether all links keep a distance [m] at poses (T, n); neighbours keep less."""
        # the nearest first: one that is too near ends it
        return all(
            self._distance(*pair, 2 * wanted) + self._allowed.get(pair, 0.0) >= wanted
            for _, pair in self._close(q, wanted, nearest_first=True)
        )

    def shortfall(self, q: Array, wanted: float) -> tuple[float, Array]:
        """Return Σ over poses and pairs of (1 − d/wanted)² where d < wanted, and its gradient.

        Poses are (T, n) [rad], ``wanted`` is the distance to keep [m]; the gradient is (T, n)
        [1/rad].
        """
        total, gradient = 0.0, np.zeros_like(q)
        ends = np.zeros((6, 1))
        one, two = np.zeros((2, 3, self.model.nv))
        for k, (i, j) in self._close(q, wanted):
            d = self._distance(i, j, wanted, ends)
            near = self._allowed.get((i, j), 0.0)
            if d + near >= wanted:
                continue
            a, b = ends[:3, 0], ends[3:, 0]
            short = 1 - (d + near) / wanted
            total += short**2
            if abs(d) > 1e-9:
                mujoco.mj_comPos(self.model, self.data)  # the Jacobians need it
                mujoco.mj_jac(self.model, self.data, one, None, a, self.model.geom_bodyid[i])
                mujoco.mj_jac(self.model, self.data, two, None, b, self.model.geom_bodyid[j])
                gradient[k] -= 2 * short / wanted * (((b - a) / d) @ (two - one))
        return total, gradient


def used(state: State, torque: Array, bounds: MotionBounds) -> dict[str, float]:
    """Return the largest part of each limit that a motion uses, margins included [-]."""
    q, dq, ddq = state
    half = (bounds.high - bounds.low) / 2
    return {
        "position": float(np.max(np.abs(q - bounds.low - half) / half)),
        "velocity": float(np.max(np.abs(dq) / bounds.velocity)),
        "acceleration": float(np.max(np.abs(ddq) / bounds.acceleration)),
        "torque": float(np.max(np.abs(torque) / bounds.torque)),
    }
