"""The impedance controller's model of the arm's dynamics, which may be wrong."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.friction.model import StickingModel
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class ControllerModel:
    """The arm's dynamics as the controller has them, rotors added.

    Where it is not the plant's (payload, tilt), the robot compensates the wrong gravity, and the
    difference acts on the arm.
    """

    def __init__(self, arm: Arm, sticking: StickingModel, nsim: int, threads: int) -> None:
        """Make it for N arms.

        Args:
            arm: as the controller takes it to be.
            sticking: the plant's model.
            nsim: number of arms.
            threads: threads, 0 for all processors.
        """
        model = arm.bare_model()
        # few MjData for all arms stay in the cache: every update computes everything again
        self._batch = Batch(model, nsim, threads)
        self._qpos = self._batch.bind("qpos")
        self._bias, self._mass = self._batch.bind("qfrc_bias"), self._batch.bind("M")
        self._qvel = self._batch.bind("qvel")
        self._rotor = sticking.parameters.rotor_inertia
        self._rows, self._columns = _entries(model)
        self._true: Batch | None = None
        if arm.xml != sticking.arm.xml:
            self._true = Batch(sticking.arm.bare_model(), nsim, threads)
            self._true_qpos = self._true.bind("qpos")
            self._true_bias = self._true.bind("qfrc_bias")
        self.mass = np.zeros((nsim, model.nv, model.nv))
        """(N, n, n) joint-space inertia, rotors included [kg·m²]."""
        self.missing = np.zeros((nsim, model.nv))
        """(N, n) torque that acts on the joints because gravity is compensated wrongly [N·m]."""

    @property
    def is_wrong(self) -> bool:
        """Whether it is not the plant's, so that `missing` has to be kept up to date."""
        return self._true is not None

    def torques(self, q: Array, dq: Array, gravity: Array, coriolis: Array) -> None:
        """Write (N, n) gravity and Coriolis and centrifugal torques at angles and speeds [N·m]."""
        self._qpos[:], stage = q, mujoco.mjtStage.mjSTAGE_VEL
        self._batch.forward(stage=stage)
        gravity[:] = self._bias
        self._qvel[:] = dq
        self._batch.forward(stage=stage)
        np.subtract(self._bias, gravity, out=coriolis)
        self._qvel[:] = 0.0

    def update(self, q: Array) -> None:
        """Take the present angles (N, n) [rad]."""
        self._qpos[:] = q
        biased = self._true is not None
        stage = mujoco.mjtStage.mjSTAGE_VEL if biased else mujoco.mjtStage.mjSTAGE_POS
        self._batch.forward(stage=stage)
        _spread(self._mass, self._rows, self._columns, self._rotor, self.mass)
        if self._true is not None:
            self._true_qpos[:] = q
            self._true.forward(stage=stage)
            np.subtract(self._bias, self._true_bias, out=self.missing)


def _entries(model: mujoco.MjModel) -> tuple[Index, Index]:
    """Return (row, column) of every entry of MuJoCo's sparse inertia `M`."""
    count = np.asarray(model.M_rownnz)
    rows = np.repeat(np.arange(model.nv), count)
    return rows, np.asarray(model.M_colind)[: len(rows)]


@compiled
def _spread(entries: Array, rows: Index, columns: Index, rotor: Array, mass: Array) -> None:
    """Write the inertias (N, n, n) of MuJoCo's sparse entries (N, E), rotors (n,) added."""
    for i in range(len(mass)):
        for k in range(len(rows)):
            mass[i, rows[k], columns[k]] = mass[i, columns[k], rows[k]] = entries[i, k]
        for j in range(len(rotor)):
            mass[i, j, j] += rotor[j]
