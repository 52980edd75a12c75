"""Measured torques of all joints as arrays, and the data that causes may use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, Job, configurations
from stiction_envs.gap.tables.whole_arm import NOMINAL, Quantity, WholeArm
from stiction_envs.measured import BaseTable, DitheredRow

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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

    def __str__(self) -> str:
        """Return joint, pose, direction and dither."""
        dither = "no dither" if self.is_base else f"{self.frequency:g} Hz, {self.amplitude:.4g} N·m"
        return f"joint {self.where.joint} {self.where.load} {self.where.direction}, {dither}"

    @property
    def job(self) -> Job:
        """The simulated experiment that predicts it."""
        return Job(self.where, self.frequency, self.amplitude)


class Readings:
    """The readings of all joints that have dithered torques, as arrays of length N."""

    def __init__(self, base: BaseTable, dithered: Sequence[DitheredRow]) -> None:
        good = [x for x in dithered if np.isfinite(x.tau_sje_nm)]
        self.joints = sorted({x.joint for x in good})
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
        for x in good:
            where = Configuration(x.joint, x.load, x.direction)
            reading = Reading(
                where=where,
                frequency=x.frequency_hz,
                amplitude=x.amplitude_nm,
                block=(x.frequency_hz, round(x.scale, 1)),
                torque=where.sign * x.tau_sje_nm,
            )
            self.all.append(reading)
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

    def dithered(self, joint: int) -> dict[Configuration, tuple[int, ...]]:
        """Return the dithered torques of each configuration of a joint."""
        out: dict[Configuration, tuple[int, ...]] = {}
        for i, r in enumerate(self.all):
            if r.where.joint == joint and not r.is_base:
                out[r.where] = (*out.get(r.where, ()), i)
        return out

    def jobs(self, joint: int) -> list[Job]:
        """Return the experiments of a joint's readings."""
        return [self.all[i].job for i in self.of_joints([joint])]

    def of_joints(self, joints: Sequence[int]) -> Index:
        """Return which readings are of some joints."""
        return np.flatnonzero(np.isin(self.joint, joints))


@dataclass(frozen=True, kw_only=True, eq=False)
class TableData:
    """The data that a cause may use: the readings and the nominal arm."""

    readings: Readings
    unit: Array
    """(N,) friction of the nominal arm in the pose of each reading [N·m]."""
    whole: WholeArm
    """The nominal arm."""

    @property
    def loads(self) -> Array:
        """(n, 2) signed load in both poses [N·m]."""
        return self.whole.poses.signed

    def nominal(self, field: str, joint: int) -> float:
        """Return a friction parameter of a joint (from 1), mean over directions."""
        return float(np.mean(getattr(self.whole.friction, field)[joint - 1]))

    def neutral(self, q: Quantity) -> float:
        """Return the nominal value of a quantity; a filter that is off has its largest."""
        return float(np.clip(self.whole.value(NOMINAL, q), q.low, q.high))
