"""Torques of a rigid arm along a motion (pinocchio), and of what its file hangs on the joints."""

import numpy as np
import pinocchio as pin

from stiction_envs.arrays import Array
from stiction_envs.robots import Arm


def reach_of(model: pin.Model) -> float:
    """Return the length of the chain of joints, which no pose exceeds [m]."""
    return sum(float(np.linalg.norm(x.translation)) for x in model.jointPlacements)


def under(model: pin.Model, gravity: tuple[float, ...]) -> pin.Model:
    """Return a model under gravity x, y, z [m/s²]; () for the model's gravity."""
    if not gravity:
        return model
    out = model.copy()
    out.gravity.linear = np.array(gravity)
    return out


def inverse_dynamics(model: pin.Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return (T, n) torque of M(q)q̈ + C(q, q̇)q̇ + g(q) [N·m] (pinocchio's RNEA)."""
    data = model.createData()
    out = np.empty_like(q)
    for k in range(len(q)):
        out[k] = pin.rnea(model, data, q[k], dq[k], ddq[k])
    return out


def gravity_torque(model: pin.Model, q: Array) -> Array:
    """Return (T, n) gravity torque g(q) [N·m]."""
    data = model.createData()
    return np.array([pin.computeGeneralizedGravity(model, data, x) for x in q])


def gravity_by_axis(model: pin.Model, q: Array, axes: int = 3) -> Array:
    """Return (T, n, axes) gravity torque of the model's gravity along x, y and z [N·m]."""
    size = float(np.linalg.norm(model.gravity.linear))
    each = [gravity_torque(under(model, tuple(x)), q) for x in size * np.eye(3)[:axes]]
    return np.stack(each, axis=-1)


def passive_torque(arm: Arm, q: Array) -> Array:
    """Return (T, n) torque of the springs of the robot's file less what its gravcomp carries [N·m].

    It adds to the torque that a motor must have, as inverse dynamics do.
    """
    stated = arm.stated
    out = stated.stiffness * (q - stated.springref)
    if stated.gravcomp:
        out -= gravity_torque(arm.pinocchio(compensated=True), q)
    return np.asarray(out)


def mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return (T, n, n) M(q) [kg·m²]."""
    work = model.createData()
    out = np.empty((*q.shape, q.shape[1]))
    for k, x in enumerate(q):
        out[k] = pin.crba(model, work, x)
    upper = np.triu(out)
    return np.asarray(upper + np.swapaxes(np.triu(upper, 1), 1, 2))


def gravity_slopes(model: pin.Model, q: Array) -> Array:
    """Return (T, n, n) ∂g/∂q [N·m/rad]."""
    work = model.createData()
    return np.array([pin.computeGeneralizedGravityDerivatives(model, work, x) for x in q])
