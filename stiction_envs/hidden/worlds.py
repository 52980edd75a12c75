"""An arm as it really is, with all that a hidden cause may change, and its MuJoCo model."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.errors import checked_array
from stiction_envs.friction.parameters import CONTROL_DT
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import from_pseudo_inertia, inertial_parameters, pseudo_inertia

CENTRE = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.9, 0.5])
"""Middle of the motions of joints 1 to 7 [rad]; assumed."""
REACH = np.array([0.9, 0.6, 0.9, 0.6, 0.9, 0.7, 0.9])
"""How far the poses lie from the centre [rad]; assumed: within the Panda's limits, with room for
the motion."""
STEP = CONTROL_DT  # step of the simulation [s]
PRESLIDING_DISTANCE = 1e-4
"""Presliding distance of joints without visible presliding [rad]; assumed."""
RADIUS = 0.03  # radius of a payload, a solid sphere [m]; assumed
CENTRE_M = 0.1
"""Standard deviation of a centre of mass per unit of scatter [m]: at 3 % 3 mm; assumed."""
MOST = 0.2  # largest scatter [-] (assumed): masses stay positive up to five standard deviations


ZERO: Any = 0.0
ONE: Any = 1.0
"""Values of every joint, from which `World` makes arrays."""


@dataclass(kw_only=True)
class World:
    """An arm before it is simulated; arrays (n, ...) are of joints, one value is that of all."""

    rigid: Arm = field(default_factory=lambda: load_arm("panda"))
    """Links as they are, before hidden causes."""
    seconds: float = 1.0
    """Length of the log [s]."""
    payload: tuple[float, Array] | None = None
    """Mass [kg] and centre of mass [m]."""
    phantom: tuple[float, Array] | None = None
    """Mass [kg] and centre [m] of a payload that the makers know and the robot lacks."""
    links: dict[int, tuple[float, Array]] = field(default_factory=dict)
    """By link (from 1): mass [kg] and centre of mass [m] beyond what the makers know."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """Lean and azimuth [rad]."""
    soft: tuple[int, float] | None = None
    """Joint (from 0) and stiffness [N·m/rad]."""
    delay: float = 0.0
    """[s]."""
    gravity_missing: float = 0.0
    """Share of the makers' gravity torque that the logged torques lack [-]."""
    middle: Array = field(default_factory=CENTRE.copy)
    """Usual angle [rad]; by default that of the simulated motions."""
    coulomb: Array = ZERO
    """Known to the robot's makers [N·m]."""
    viscous: Array = ZERO
    """Known to the robot's makers [N·m·s/rad]."""
    rotor: Array = ZERO
    """Known to the robot's makers [kg·m²]."""
    more_coulomb: Array = ZERO
    more_viscous: Array = ZERO
    stribeck: Array = ZERO
    stribeck_velocity: Array = 0.05 * ONE
    asymmetry: Array = ZERO
    load: Array = ZERO
    distance: Array = PRESLIDING_DISTANCE * ONE
    drift: Array = ZERO
    ripple: Array = ZERO
    periods: Array = ONE
    phase: Array = ZERO
    offset: Array = ZERO
    scale: Array = ONE
    armature: Array = ZERO
    spring: Array = ZERO
    spring_rest: Array = ZERO
    harmonics: Array = field(default_factory=lambda: np.zeros((1, 2, 2)))
    """Cosine and sine of the first two harmonics of each joint's angle [N·m]."""
    hump: Array = field(default_factory=lambda: np.array([[0.0, 0.0, 1.0]]))
    """Height [N·m], middle [rad] and standard deviation [rad] of a Gaussian over the angle."""
    zero: Array = ZERO
    """Reading of each joint less its angle [rad]."""

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self) if f.type is Array):
            value = np.atleast_1d(np.asarray(getattr(self, name), np.float64))
            if len(value) != self.rigid.n:
                setattr(self, name, np.repeat(value, self.rigid.n, axis=0))

    def friction_level(self, v: Array, t: float | Array, load: Array) -> Array:
        """Return (..., n) level of dry friction of fast sliding [N·m], at a time [s].

        Speeds ``v`` are (..., n) [rad/s], torques ``load`` that the gears carry (..., n) [N·m].
        """
        level = self.coulomb + self.more_coulomb + self.drift * t + self.load * np.abs(load)
        return np.asarray(level + self.asymmetry * np.sign(v))

    def torque_over_angle(self, q: Array) -> Array:
        """Return (..., n) torque that depends on the angles (..., n) alone [N·m]."""
        out = self.spring * (q - self.spring_rest)
        if self.harmonics.any() or self.hump[:, 0].any():
            out = out + self.smooth_torque(q)
        if self.ripple.any():
            out = out + self.ripple * np.sin(self.periods * q + self.phase)
        return np.asarray(out)

    def smooth_torque(self, q: Array) -> Array:
        """Return (..., n) torque of harmonics and hump at angles (..., n) [N·m]."""
        k = np.arange(1, 3)[:, None] * q[..., None, :]
        waves = self.harmonics[..., 0].T * np.cos(k) + self.harmonics[..., 1].T * np.sin(k)
        height, middle, width = self.hump.T
        hump = height * np.exp(-0.5 * np.square((q - middle) / width))
        return np.asarray(waves.sum(axis=-2) + hump)

    def read_out(self, t: Array, tau: Array) -> Array:
        """Return torques (T, n) as the sensors show them at even times (T,), without noise."""
        out = tau.copy()
        if self.delay:
            for j in range(tau.shape[1]):
                out[:, j] = np.interp(t + self.delay, t, out[:, j])
        return np.asarray(self.scale * out + self.offset)

    def model(self) -> mujoco.MjModel:
        """Return the arm without friction; a soft gear is a joint more, ``inner``."""
        spec = self.rigid.spec()
        for i, joint in enumerate(list(spec.joints)):
            joint.armature = self.rotor[i] + self.armature[i]
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.option.timestep = STEP
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        lean, towards = self.tilt
        if lean:
            g = -spec.option.gravity[2]
            spec.option.gravity = [
                g * np.sin(lean) * np.cos(towards),
                g * np.sin(lean) * np.sin(towards),
                -g * np.cos(lean),
            ]
        for number, (more, shift) in self.links.items():
            link = spec.body(self.rigid.link_names[number - 1])
            # another density, moved within the link: a body that exists
            link.fullinertia = np.array(link.fullinertia) * (1 + more / link.mass)
            link.mass, link.ipos = link.mass + more, link.ipos + shift
        for mass, com in (x for x in (self.payload, self.phantom) if x is not None):
            add_to_flange(spec, self.rigid.end_effector, mass, com)
        if self.soft is not None:
            joint = list(spec.joints)[self.soft[0]]
            inner = joint.parent.add_joint(name="inner", axis=joint.axis, pos=joint.pos)
            inner.limited = mujoco.mjtLimited.mjLIMITED_FALSE
            inner.stiffness = [self.soft[1], 0, 0]
            inner.damping = [2 * 0.1 * np.sqrt(self.soft[1] * 0.1), 0, 0]
        return spec.compile()


def add_to_flange(
    spec: mujoco.MjSpec, flange: str, mass: float, com: Sequence[float] | Array
) -> None:
    """Add a payload of a mass [kg] with its centre at (3,) [m] to the frame of a site."""
    site = next(s for s in spec.sites if s.name == flange)
    load = site.parent.add_body(pos=site.pos, quat=site.quat)
    load.mass, load.ipos, load.inertia = mass, com, [0.4 * mass * RADIUS**2] * 3
    load.explicitinertial = True


def inverse_torque(model: mujoco.MjModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Return (T, n) torque of MuJoCo's inverse dynamics, without limits and contacts [N·m]."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, out = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out


def scattered(phi: ArrayLike, scatter: float, rng: np.random.Generator) -> Array:
    """Return (n, 10) parameters of links that differ from ``phi`` by a ``scatter``.

    Each link's mass is multiplied by 1 + N(0, s), its centre moved by N(0, s · `CENTRE_M`)
    along each axis, and the link stretched and rotated about its centre by A = I + N(0, s) (3, 3):
    J' = (m'/m) T J Tᵀ with T the affine map of all this, which keeps J positive definite
    (`pseudo_inertia`). s is ``scatter``; one out of range is refused.
    """
    checked_array(scatter, "scatter", (), low=0, high=MOST)
    before = np.asarray(phi, dtype=np.float64)
    n = len(before)
    mass = 1 + scatter * rng.normal(size=n)
    shift = scatter * CENTRE_M * rng.normal(size=(n, 3))
    stretch = np.eye(3) + scatter * rng.normal(size=(n, 3, 3))
    centre = before[:, 1:4] / before[:, :1]
    affine = np.tile(np.eye(4), (n, 1, 1))
    affine[:, :3, :3] = stretch
    affine[:, :3, 3] = centre + shift - (stretch @ centre[..., None])[..., 0]
    moved = affine @ pseudo_inertia(before) @ affine.transpose(0, 2, 1)
    return from_pseudo_inertia(mass[:, None, None] * moved)


def with_scattered_links(arm: Arm, scatter: float, rng: np.random.Generator) -> Arm:
    """Return an arm with links that are all a little off: see `scattered`."""
    return with_inertias(arm, scattered(inertial_parameters(arm.pinocchio()), scatter, rng))
