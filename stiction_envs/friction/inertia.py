"""Mass matrix and gravity torque of the rigid arm, without rotors."""

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.robots import Arm


def mass_and_gravity(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Return (M, n, n) [kg·m²] and (M, n) [N·m] of the rigid arm at poses q (M, n) [rad]."""
    model = arm.model()
    data = mujoco.MjData(model)
    mass, gravity = np.zeros((len(q), model.nv, model.nv)), np.empty((len(q), model.nv))
    for i, pose in enumerate(q):
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass[i])
        gravity[i] = data.qfrc_bias
    return mass, gravity


def link_inertia(arm: Arm, q: Array) -> Array:
    """Return (M, n) diagonal of the rigid mass matrix [kg·m²] at poses q (M, n) [rad].

    The inertia that each joint moves when the others are locked, without rotors.
    """
    return np.diagonal(mass_and_gravity(arm, q)[0], axis1=1, axis2=2).copy()
