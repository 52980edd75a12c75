"""Measured torques of all joints as arrays, and the data that causes may use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, Job, configurations
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured import BaseTable, DitheredRow

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Cell:
    """One measured dithered torque."""

    row: DitheredRow

    @property
    def configuration(self) -> Configuration:
        """Joint, pose and direction."""
        return Configuration(self.row.joint, self.row.load, self.row.direction)

    @property
    def change(self) -> float:
        """Measured |τ_SJE| / |τ_base| − 1 [-]."""
        return abs(self.row.tau_sje_nm) / abs(self.row.tau_base_nm) - 1.0


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One base torque, or one dithered torque."""

    where: Configuration
    frequency: float
    amplitude: float
    block: tuple[float, float]
    """Readings that are left out together: (frequency [Hz], scale [-]); (0, 0): base torques."""
    torque: float
    """Measured, along the ramp: negative if the joint moved against it [N·m]."""

    @property
    def is_base(self) -> bool:
        """Whether it is a base torque."""
        return self.amplitude == 0.0

    @property
    def job(self) -> Job:
        """The simulated experiment that predicts it."""
        return Job(self.where, self.frequency, self.amplitude)


class Readings:
    """The readings of all joints that have dithered torques, as arrays of length N."""

    def __init__(self, base: BaseTable, cells: Sequence[Cell]) -> None:
        good = [c for c in cells if np.isfinite(c.row.tau_sje_nm)]
        self.joints = sorted({c.row.joint for c in good})
        self.all = [
            Reading(
                where=w,
                frequency=0.0,
                amplitude=0.0,
                block=(0.0, 0.0),
                torque=float(w.sign * base.tau[w.index]),
            )
            for w in (configurations(base.n_joints, self.joints) if self.joints else [])
        ]
        self.all += [
            Reading(
                where=c.configuration,
                frequency=c.row.frequency_hz,
                amplitude=c.row.amplitude_nm,
                block=(c.row.frequency_hz, round(c.row.scale, 1)),
                torque=c.configuration.sign * c.row.tau_sje_nm,
            )
            for c in good
        ]
        index = [r.where.index for r in self.all]
        self.joint = np.array([i[0] + 1 for i in index], dtype=np.int64)
        self.pose = np.array([i[1] for i in index], dtype=np.int64)
        self.sign = np.array([r.where.sign for r in self.all])
        self.torque = np.array([r.torque for r in self.all])
        self.frequency = np.array([r.frequency for r in self.all])
        self.base = np.array([r.is_base for r in self.all], dtype=bool)
        self.blocks = sorted({r.block for r in self.all})
        self.block = np.array([self.blocks.index(r.block) for r in self.all], dtype=np.int64)
        self.level = 2 * np.searchsorted(self.joints, self.joint) + self.pose
        """(N,) number of the friction level of a reading."""

    def of(self, where: Sequence[Configuration]) -> Mask:
        """Return (N,) which readings are of some configurations."""
        return np.array([r.where in where for r in self.all], dtype=bool)

    def jobs(self, joint: int) -> list[Job]:
        """Return the experiments of a joint's readings."""
        return [self.all[i].job for i in self.of_joints([joint])]

    def of_joints(self, joints: Sequence[int]) -> Index:
        """Return which readings are of some joints."""
        return np.flatnonzero(np.isin(self.joint, joints))

    def base_of(self, values: Array, i: int) -> float:
        """Return the value (N,) of the base torque that belongs to a reading."""
        where = self.all[i].where
        return float(
            next(values[k] for k, x in enumerate(self.all) if x.is_base and x.where == where)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TableData:
    """The data that a cause may use: the readings and the nominal arm."""

    readings: Readings
    unit: Array
    """(N,) friction of the nominal arm in the pose of each reading [N·m]."""
    loads: Array
    """(n, 2) signed load in both poses [N·m]."""
    friction: FrictionParameters
    """Nominal, of one arm."""

    def nominal(self, field: str, joint: int) -> float:
        """Return a friction parameter of a joint (from 1), mean over directions."""
        return float(np.mean(getattr(self.friction, field)[joint - 1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Predictions of the readings with and without a cause."""

    data: TableData
    with_it: Array
    """(N,) [N·m]."""
    without: Array
    """(N,) [N·m]."""
