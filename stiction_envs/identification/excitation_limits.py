"""Limits of an excitation: position, speed, acceleration, torque, and distances.

Distances are between the collision geometry of the arm's MJCF, and to a floor at the world's z = 0,
by MuJoCo's collision detection with a margin. Pairs that touch at rest (a foot on the floor,
neighbours) are left out. Pairs that are near at rest keep half of their distance there.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.identification.settings import ExcitationSettings
from stiction_envs.robots import ARMS, Arm
from stiction_envs.robots.arm_toml import lookup, per_joint

NEAR = 0.05
"""Links that are nearer at rest are neighbours: half of their distance there is kept [m]; assumed.
"""
TOUCHING = 1e-3  # pairs that are nearer at rest touch, and are left out [m]; assumed
FLANGE_BALL = 0.05  # radius of the ball in place of an arm without collision geometry [m]; assumed
MEMORY = 2**26  # bytes for contacts of all pairs of shapes
Pair = tuple[int, int]  # Two shapes, by their numbers
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
        """Look for the pairs of geometry that touch or are near at rest."""
        spec = arm.spec()
        self.own_geometry = any(g.contype or g.conaffinity for g in spec.geoms)
        if not self.own_geometry:
            flange = next(x for x in spec.sites if x.name == arm.end_effector)
            ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [FLANGE_BALL, 0, 0], "mass": 0}
            flange.parent.add_geom(pos=flange.pos, **ball, **_SOLID)
        floor = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [5, 5, 0.1]}
        spec.worldbody.add_geom(name="excitation_floor", **floor, **_SOLID)
        spec.memory = MEMORY
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._touching: set[Pair] = set()
        at_rest = self._distances(arm.rest, NEAR)
        self._touching |= {pair for pair, d in at_rest.items() if d <= TOUCHING}
        # neighbours keep half of their distance at rest
        near = {p: d for p, d in at_rest.items() if TOUCHING < d < settings.clearance}
        self._allowed = {p: settings.clearance - d / 2 for p, d in near.items()}
        self.notes = [
            f"{self._link(i)} and {self._link(j)} are {1e3 * near[i, j]:.0f} mm apart at rest: "
            "half of that is kept"
            for i, j in near
        ]

    def _link(self, geometry: int) -> str:
        return str(self.model.body(int(self.model.geom_bodyid[geometry])).name)

    def _distances(self, q: Array, most: float) -> dict[Pair, float]:
        """Return distances [m] below ``most`` at a pose (n,)."""
        self.model.geom_margin[:] = self.model.body_margin[:] = most
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        found: dict[Pair, float] = {}
        contacts = self.data.contact
        for (i, j), d in zip(contacts.geom, contacts.dist, strict=True):
            pair = min(i, j), max(i, j)
            if d < found.get(pair, most) and pair not in self._touching:
                found[pair] = float(d)
        return found

    def least(self, q: Array, most: float = 0.5) -> Array:
        """Return (T,) least distance at poses (T, n) [m], at most ``most``."""
        return np.array([min(self._distances(x, most).values(), default=most) for x in q])

    def shortfall(self, q: Array, wanted: float) -> float:
        """Return Σ of (1 − d/wanted)² over poses (T, n) and pairs whose distance d is short [m].

        Neighbours keep less.
        """
        distances = (x for pose in q for x in self._distances(pose, wanted).items())
        short = (1 - (d + self._allowed.get(pair, 0.0)) / wanted for pair, d in distances)
        return sum(x**2 for x in short if x > 0)
