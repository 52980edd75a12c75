"""Gains of the servos that bring joints to a pose and hold them there, from the arm itself.

Stiffness follows the torque limit, or the friction where that is a large share of the limit: a
joint comes to rest where the servo's torque no longer beats what resists it. Damping is critical
for what a joint moves while the others are locked. They are not: in a light wrist without rotors
such a damper turns a motion round within a step, faster than it came. Euler's
step of length h is stable while

    2 M - h C - h²/2 K

is positive definite, with all that is damped and sprung explicitly in C and K: servos, bristles
(σ1, σ0), joint springs. What friction and springs leave of the 2 goes to the dampers by half, the
share with which one alone stops a motion within a step.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.friction.model import StickingModel
from stiction_envs.method_settings import NotNegative

TORQUE_MARGIN = 10.0
"""Least torque limit that a servo's stiffness assumes, over what resists the joint [-]. From the
protocol: at 1.2/rad times the limit, friction (2 % scatter) is beaten within the 0.1 rad of
``start_tolerance`` (0.002 rad scatter) from 9.4 on, three standard deviations each."""


@dataclass(frozen=True, kw_only=True)
class Approach:
    """Numbers of the way to a pose, and of its scatter; `sje.toml` has their sources."""

    return_time: NotNegative  # Time of the move to the pose [s]
    settle_time: NotNegative  # Time for which the pose is held afterwards [s]
    hold_stiffness: NotNegative
    """Servo stiffness over torque limit [1/rad]; more where friction asks for it."""
    hold_damping_ratio: NotNegative  # Damping ratio of the servo [-]
    pose_scatter: NotNegative  # Standard deviation of the pose from one iteration to the next [rad]
    friction_scatter: NotNegative  # Standard deviation of the dry friction, relative [-]


class Servos:
    """Servos of one arm's joints."""

    def __init__(self, sticking: StickingModel, approach: Approach) -> None:
        """Make the servos of an arm with the gains that an approach asks for."""
        self.sticking, self.approach = sticking, approach
        self.torque_limit = np.array(sticking.arm.limits.torque)

    def resistance(self, signed: Array, load: Array) -> Array:
        """Return the torque (M, n) that a servo must beat [N·m]: stiction and offset of the model.

        The load of the joints is ``signed`` (M, n), its size ``load`` (M, n) [N·m].
        """
        p = self.sticking.parameters
        offset = p.offset + p.gravity_error * np.clip(signed, -p.load_high, p.load_high)
        return p.stiction_at(load).max(axis=-1) + np.abs(offset)

    def stiffness(self, resistance: Array) -> Array:
        """Return the stiffness (M, n) [N·m/rad] against a resistance (M, n) [N·m]."""
        counted = np.maximum(self.torque_limit, TORQUE_MARGIN * resistance)
        return self.approach.hold_stiffness * counted

    def inertia(self, q: Array) -> tuple[Array, Array]:
        """Return the inertia [kg·m²] that joints move at poses q (M, n) [rad], rotors included.

        It is (M, n) for each joint with the others locked, then (M, nv, nv) mass matrices of the
        model's motors and springs.
        """
        s = self.sticking
        data = mujoco.MjData(s.model)
        mass = np.zeros((len(q), s.model.nv, s.model.nv))
        for i, pose in enumerate(q):
            data.qpos[s.motor] = pose
            mujoco.mj_fwdPosition(s.model, data)
            mujoco.mj_fullM(s.model, data, mass[i])
        return link_inertia(s.arm, q) + s.parameters.rotor_inertia, mass

    def damping(self, stiffness: Array, inertia: Array, mass: Array) -> Array:
        """Return the damping (M, n) [N·m·s/rad]: critical, or as much as the step allows.

        ``inertia`` and ``mass`` are those of `inertia`; ``stiffness`` is (M, n) [N·m/rad].
        """
        critical = 2 * self.approach.hold_damping_ratio * np.sqrt(stiffness * inertia)
        s, p = self.sticking, self.sticking.parameters
        h, spring = s.timestep, s.spring[s.spring >= 0]
        servo, others = np.zeros(mass.shape[:2]), np.zeros(mass.shape[:2])
        servo[:, s.motor] = h * critical
        others[:, s.motor] = h * s.bristle_damping_of(p)
        others[:, s.motor] += h * h / 2 * (stiffness + p.bristle_stiffness)
        others[:, spring] = h * h / 2 * p.joint_stiffness[s.spring >= 0]
        left = np.maximum(1.0 - _largest(mass, others) / 2, 0.0)
        needed = np.maximum(_largest(mass, servo), np.finfo(float).tiny)
        return np.minimum(1.0, left / needed)[:, None] * critical


def _largest(mass: Array, diagonal: Array) -> Array:
    """Return (M,) the largest eigenvalue of M⁻¹ D, of mass (M, k, k) and diagonals D ≥ 0 (M, k)."""
    root = np.sqrt(diagonal)
    inverse = root[:, :, None] * np.linalg.inv(mass) * root[:, None, :]
    return np.linalg.eigvalsh(inverse)[:, -1]
