"""The torque a joint transmits: what its friction and its gravity error depend on.

For most joints it is the gravity torque about the axis. A joint that never sees one – joint 1 of
an upright arm, the symmetric last joint of an iiwa – still carries the arm in its bearing:
there the load is the gravity *moment across the axis* (the bearing's tilting moment), unsigned.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.robots import Arm

if TYPE_CHECKING:
    from stiction_envs.friction.model import StickingModel

Array = NDArray[np.float64]
NO_GRAVITY_NM = 0.02
"""Largest gravity torque under which a joint counts as one that sees none [N·m]; assumed."""
_SAMPLES = 256


class LoadSensor:
    """Reads the load of every joint from a batch's own kinematics."""

    def __init__(self, sticking: StickingModel, batch: Any) -> None:
        model = sticking.model
        self._joint = model.dof_jntid[sticking.motor]
        self._body = model.jnt_bodyid[self._joint]
        self._weight = model.body_subtreemass[self._body][:, None] * model.opt.gravity
        self._com = batch.bind("subtree_com")
        self._anchor, self._axis = batch.bind("xanchor"), batch.bind("xaxis")
        self.bearing = sticking.bearing

    def read(self, ids: Any) -> tuple[Array, Array]:
        """Return (signed, absolute) load of simulations ``ids``, each (M, n) [N·m].

        The signed one is g(q) of M q̈ + C q̇ + g = τ; where the bearing counts both are its moment.
        """
        # written out by component: a reduction's order could depend on the array's shape
        joint = self._joint
        r = self._com[ids][:, self._body] - self._anchor[ids][:, joint]
        axis, w = self._axis[ids][:, joint], self._weight
        rx, ry, rz = r[..., 0], r[..., 1], r[..., 2]
        mx = ry * w[:, 2] - rz * w[:, 1]
        my = rz * w[:, 0] - rx * w[:, 2]
        mz = rx * w[:, 1] - ry * w[:, 0]
        about = mx * axis[..., 0] + my * axis[..., 1] + mz * axis[..., 2]
        if not self.bearing.any():
            return -about, np.abs(about)
        across = np.maximum(mx * mx + my * my + mz * mz - about * about, 0.0)
        bearing = np.sqrt(across)
        signed = np.where(self.bearing, bearing, -about)
        return signed, np.abs(signed)


def gravity_torque(arm: Arm, q: Array) -> Array:
    """Return (M, n) gravity torque g(q) [N·m] of the rigid arm at poses q (M, n) [rad]."""
    model = arm.model()
    data = mujoco.MjData(model)
    out = np.empty_like(q)
    for i, pose in enumerate(q):
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        out[i] = data.qfrc_bias
    return out


def bearing_loaded(arm: Arm) -> NDArray[np.bool_]:
    """Return (n,) which joints see no gravity torque in any of a fixed set of random poses."""
    low, high = arm.limits.position.T
    q = np.random.default_rng(0).uniform(low, high, size=(_SAMPLES, arm.n))
    weightless: NDArray[np.bool_] = np.abs(gravity_torque(arm, q)).max(axis=0) < NO_GRAVITY_NM
    return weightless
