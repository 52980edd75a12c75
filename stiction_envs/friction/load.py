"""The torque a joint transmits: what its friction and its gravity error depend on.

For most joints it is the gravity torque about the axis. A joint that never sees one – joint 1 of
an upright arm, the symmetric last joint of an iiwa – still carries the arm in its bearing:
there the load is the gravity *moment across the axis* (the bearing's tilting moment), unsigned.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.robots import Arm

Array = NDArray[np.float64]
NO_GRAVITY_NM = 0.02
"""Largest gravity torque under which a joint counts as one that sees none [N·m]; assumed."""
_SAMPLES = 256


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
