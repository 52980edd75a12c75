"""A link that is not where the motor is: what its deflection does to all joints' torques."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stiction_envs.gap.logs.causes.base import Array, along_runs
from stiction_envs.gap.logs.data import Data


def mass_matrix(data: Data) -> Array:
    """Return (T, n, n) M(q) of the nominal arm [kg·m²]."""

    def make() -> Array:
        work = data.pinocchio.createData()
        out = np.empty((*data.q.shape, data.n))
        for k, q in enumerate(data.q):
            out[k] = pin.crba(data.pinocchio, work, q)
        upper = np.triu(out)
        return np.asarray(upper + np.swapaxes(np.triu(upper, 1), 1, 2))

    return data.cached("mass_matrix", make)


def gravity_slope(data: Data) -> Array:
    """Return (T, n, n) ∂g/∂q of the nominal arm [N·m/rad]."""

    def make() -> Array:
        model, work = data.pinocchio, data.pinocchio.createData()
        return np.array([pin.computeGeneralizedGravityDerivatives(model, work, q) for q in data.q])

    return data.cached("gravity_slope", make)


def torque_of(data: Data, joint: int, deflection: Array) -> Array:
    """Return (T, n) M[:, j] δ̈ + ∂g/∂q[:, j] δ of a link that stands δ (T,) from its motor [N·m].

    First order in δ; Coriolis terms of δ̇ are left out.
    """
    bend = along_runs(data, along_runs(data, deflection))
    own, slope = mass_matrix(data)[:, :, joint], gravity_slope(data)[:, :, joint]
    return own * bend[:, None] + slope * deflection[:, None]


def own_torque_of(data: Data, joint: int, deflections: Array) -> Array:
    """Return (T, k) `torque_of` k deflections (T, k) on the joint itself [N·m]."""
    bend = along_runs(data, along_runs(data, deflections))
    own, slope = mass_matrix(data)[:, joint, joint], gravity_slope(data)[:, joint, joint]
    return np.asarray(own[:, None] * bend + slope[:, None] * deflections)
