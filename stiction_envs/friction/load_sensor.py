"""The load of every joint while simulations run; friction and gravity error depend on load.

For most joints it is the gravity torque about the axis. A joint that never sees one – joint 1 of
an upright arm, the symmetric last joint of an iiwa – still carries the arm in its bearing: there
the load is the gravity *moment across the axis* (the bearing's tilting moment), unsigned.
"""

from typing import NamedTuple

import numpy as np
from mujoco.batch import Batch

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.friction.model import StickingModel


class LoadSensor(NamedTuple):
    """Kinematics of the simulations of a batch, from which compiled code reads loads."""

    com: Array  # (N, bodies, 3) centre of mass of each body's subtree [m]
    anchor: Array  # (N, joints of the model, 3) a point of each axis [m]
    axis: Array  # (N, joints of the model, 3)
    joint: Index  # (n,) the model's joint of each joint of the arm
    body: Index  # (n,) the body that it moves
    weight: Array  # (n, 3) of that body's subtree [N]
    bearing: Bools  # (n,) joints whose load is their bearing's tilting moment


def load_sensor(sticking: StickingModel, batch: Batch) -> LoadSensor:
    """Return the sensor of a batch's own kinematics."""
    model = sticking.model
    joint = model.dof_jntid[sticking.motor].astype(np.int64)
    body = model.jnt_bodyid[joint].astype(np.int64)
    return LoadSensor(
        com=batch.bind("subtree_com"),
        anchor=batch.bind("xanchor"),
        axis=batch.bind("xaxis"),
        joint=joint,
        body=body,
        weight=model.body_subtreemass[body][:, None] * model.opt.gravity,
        bearing=sticking.bearing,
    )


@inlined
def read_load(i: int, j: int, a: LoadSensor) -> float:
    """Return the signed load of a joint (from 0) of simulation ``i`` [N·m].

    It is g(q) of M q̈ + C q̇ + g = τ, or the moment on the bearing where that counts.
    """
    body, joint = a.body[j], a.joint[j]
    rx = a.com[i, body, 0] - a.anchor[i, joint, 0]
    ry = a.com[i, body, 1] - a.anchor[i, joint, 1]
    rz = a.com[i, body, 2] - a.anchor[i, joint, 2]
    mx = ry * a.weight[j, 2] - rz * a.weight[j, 1]
    my = rz * a.weight[j, 0] - rx * a.weight[j, 2]
    mz = rx * a.weight[j, 1] - ry * a.weight[j, 0]
    about = mx * a.axis[i, joint, 0] + my * a.axis[i, joint, 1] + mz * a.axis[i, joint, 2]
    if a.bearing[j]:
        return np.sqrt(max(mx * mx + my * my + mz * mz - about * about, 0.0))
    return -about


@compiled
def read_loads(ids: Index, a: LoadSensor) -> Array:
    """Return the signed loads (M, n) of simulations ``ids`` [N·m]."""
    out = np.empty((len(ids), len(a.joint)))
    for row in range(len(ids)):
        for j in range(len(a.joint)):
            out[row, j] = read_load(ids[row], j, a)
    return out
