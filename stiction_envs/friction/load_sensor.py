"""The load of every joint while simulations run; friction and gravity error depend on load.

For most joints it is the gravity torque about the axis. A joint that never sees one – joint 1 of
an upright arm, the symmetric last joint of an iiwa – still carries the arm in its bearing: there
the load is the gravity *moment across the axis* (the bearing's tilting moment), unsigned.
"""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.friction.model import StickingModel

Rows = Index | Bools | slice


class LoadSensor:
    """Reads the load of every joint from a batch's own kinematics."""

    def __init__(self, sticking: StickingModel, batch: Batch) -> None:
        model = sticking.model
        self.joint = model.dof_jntid[sticking.motor]
        self.body = model.jnt_bodyid[self.joint]
        self.weight = model.body_subtreemass[self.body][:, None] * model.opt.gravity
        self._com = batch.bind("subtree_com")
        self._anchor, self._axis = batch.bind("xanchor"), batch.bind("xaxis")
        self.bearing = sticking.bearing

    def read(self, ids: Rows) -> tuple[Array, Array]:
        """Return (signed, absolute) load of simulations ``ids``, each (M, n) [N·m].

        The signed one is g(q) of M q̈ + C q̇ + g = τ; where the bearing counts both are its moment.
        """
        # written out by component: a reduction's order could depend on the array's shape
        joint = self.joint
        r = self._com[ids][:, self.body] - self._anchor[ids][:, joint]
        axis, w = self._axis[ids][:, joint], self.weight
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
