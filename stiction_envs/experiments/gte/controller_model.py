"""The impedance controller's model of the arm's dynamics, which may be wrong."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.friction.model import StickingModel
from stiction_envs.plant.loop_batch import fwd_position, fwd_velocity
from stiction_envs.robots import Arm


class Dynamics(NamedTuple):
    """One arm's model and data, in which the dynamics of all arms are computed in turn."""

    model: int
    data: int  # Their addresses
    qpos: Array  # (n,) of the data [rad]
    qvel: Array  # (n,) [rad/s]
    bias: Array  # (n,) torque of gravity, and of speeds [N·m]


class ModelArrays(NamedTuple):
    """What `renew_dynamics` computes with, and writes."""

    believed: Dynamics  # Dynamics that the controller has
    true: Dynamics  # Dynamics of the plant
    is_wrong: bool  # Whether the two differ
    entries: Array  # (E,) entries of the sparse inertia that is believed [kg·m²]
    rows: Index
    columns: Index  # (E,) where the entries are
    rotor: Array  # (n,) [kg·m²]
    mass: Array
    missing: Array  # As of `ControllerModel`, written


class ControllerModel:
    """The arm's dynamics as the controller has them, rotors added.

    Where it is not the plant's (payload, tilt), the robot compensates the wrong gravity, and the
    difference acts on the arm.
    """

    def __init__(self, arm: Arm, sticking: StickingModel, nsim: int) -> None:
        """Make it for N arms.

        Args:
            arm: as the controller takes it to be.
            sticking: the plant's model.
            nsim: number of arms.
        """
        self.is_wrong = arm.xml != sticking.arm.xml
        """Whether it is not the plant's, so that `missing` has to be kept up to date."""
        self._models = [arm.bare_model()]
        if self.is_wrong:
            self._models.append(sticking.arm.bare_model())
        self._rotor = sticking.parameters.rotor_inertia
        n = self._models[0].nv
        self.mass = np.zeros((nsim, n, n))
        """(N, n, n) joint-space inertia, rotors included [kg·m²]."""
        self.missing = np.zeros((nsim, n))
        """(N, n) torque that acts on the joints because gravity is compensated wrongly [N·m]."""
        self._made: list[tuple[ModelArrays, list[mujoco.MjData]]] = []

    def __getstate__(self) -> dict[str, object]:
        """Leave out what has addresses in this process; `arrays` makes it anew."""
        return vars(self) | {"_made": []}

    def arrays(self, part: int = 0) -> ModelArrays:
        """Return what `renew_dynamics` works on, with data of its own for each part of the arms.

        Parts are numbered from 0; the same objects are returned for the same part.
        """
        while len(self._made) <= part:
            # one MjData for all arms stays in the cache: every update computes everything again
            data = [mujoco.MjData(model) for model in self._models]
            dynamics = [
                Dynamics(model._address, d._address, d.qpos, d.qvel, d.qfrc_bias)
                for model, d in zip(self._models, data, strict=True)
            ]
            arrays = ModelArrays(
                *(dynamics[0], dynamics[-1], self.is_wrong, data[0].M),
                *_entries(self._models[0]),
                *(self._rotor, self.mass, self.missing),
            )
            self._made.append((arrays, data))  # compiled code has addresses only
        return self._made[part][0]


def _entries(model: mujoco.MjModel) -> tuple[Index, Index]:
    """Return (row, column) of every entry of MuJoCo's sparse inertia `M`."""
    count = np.asarray(model.M_rownnz)
    rows = np.repeat(np.arange(model.nv), count)
    return rows, np.asarray(model.M_colind)[: len(rows)].astype(np.int64)


@inlined
def renew_dynamics(i: int, q: Array, a: ModelArrays) -> None:
    """Write inertia, and the gravity that is compensated wrongly, of arm ``i`` at angles q (N, n).

    An arm whose angles are not finite, which the plant reports, keeps its last.
    """
    believed, true = a.believed, a.true
    total = 0.0
    for j in range(q.shape[1]):
        believed.qpos[j] = true.qpos[j] = q[i, j]
        total += q[i, j]
    if not np.isfinite(total):
        return
    fwd_position(believed.model, believed.data)
    for k in range(len(a.rows)):
        row, column = a.rows[k], a.columns[k]
        a.mass[i, row, column] = a.mass[i, column, row] = a.entries[k]
    for j in range(q.shape[1]):
        a.mass[i, j, j] += a.rotor[j]
    if a.is_wrong:
        fwd_velocity(believed.model, believed.data)
        fwd_position(true.model, true.data)
        fwd_velocity(true.model, true.data)
        for j in range(q.shape[1]):
            a.missing[i, j] = believed.bias[j] - true.bias[j]


@compiled
def renew_torques(
    i: int, q: Array, dq: Array, a: Dynamics, gravity: Array, coriolis: Array
) -> None:
    """Write the torques (N, n) of gravity, and of Coriolis and centrifugal forces, of arm ``i``.

    At angles q (N, n) [rad] and speeds dq (N, n) [rad/s]; torques in N·m.
    """
    for j in range(q.shape[1]):
        a.qpos[j] = q[i, j]
    fwd_position(a.model, a.data)
    fwd_velocity(a.model, a.data)
    for j in range(q.shape[1]):
        gravity[i, j], a.qvel[j] = a.bias[j], dq[i, j]
    fwd_velocity(a.model, a.data)
    for j in range(q.shape[1]):
        coriolis[i, j], a.qvel[j] = a.bias[j] - gravity[i, j], 0.0
