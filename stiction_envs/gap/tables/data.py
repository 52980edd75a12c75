"""Torque tables as arrays, and what causes change in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, Job, configurations
from stiction_envs.gap.tables.whole_arm import NOMINAL, Quantity, WholeArm
from stiction_envs.measured import BaseTable, DitheredRow

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class TableData:
    """The readings of all joints that have dithered torques, as arrays of length N."""

    def __init__(self, base: BaseTable, dithered: Sequence[DitheredRow], whole: WholeArm) -> None:
        """Take the readings, base torques first.

        Args:
            base: base torques of all joints.
            dithered: torques of some or all joints; those that are no numbers are left out.
            whole: the nominal arm.
        """
        self.whole = whole
        good = [x for x in dithered if np.isfinite(x.tau_sje_nm)]
        self.joints = tuple(sorted({x.joint for x in good}))
        first = configurations(base.n_joints, list(self.joints)) if good else []
        places = [Configuration(x.joint, x.load, x.direction) for x in good]
        self.jobs = [Job(w) for w in first] + [
            Job(w, x.frequency_hz, x.amplitude_nm) for w, x in zip(places, good, strict=True)
        ]
        """(N) simulated experiments that predict the readings."""
        each = [float(base.tau[w.index]) for w in first] + [x.tau_sje_nm for x in good]
        keys = [(0.0, 0.0)] * len(first) + [(x.frequency_hz, round(x.scale, 1)) for x in good]
        where = [job.configuration for job in self.jobs]
        self.joint = np.array([w.joint for w in where], dtype=np.int64)
        self.pose = np.array([w.index[1] for w in where], dtype=np.int64)
        self.sign = np.array([w.sign for w in where], dtype=np.float64)
        self.torque = self.sign * each
        """Measured, along the ramp: negative if the joint moved against it [N·m]."""
        self.base = np.arange(len(where)) < len(first)
        self.blocks = len(set(keys))
        """Number of parts that are left out together: base torques, each frequency and scale."""
        self.block = np.unique(keys, axis=0, return_inverse=True)[1].ravel() if keys else self.joint
        """Number of a reading's block; 0: base torques."""
        self.of_joint = {j: np.flatnonzero(self.joint == j) for j in self.joints}
        """The readings of each joint (from 1)."""

    @cached_property
    def unit(self) -> Array:
        """(N,) friction of the nominal arm in the pose of each reading [N·m]."""
        each = {j: [self.jobs[i] for i in rows] for j, rows in self.of_joint.items()}
        self.whole.simulate([(NOMINAL, jobs) for jobs in each.values()])
        tau = self.whole.torques(NOMINAL, self.jobs)
        level = 2 * self.joint + self.pose
        mean = {k: tau[self.base & (level == k)].mean() for k in np.unique(level).tolist()}
        return np.array([mean[k] for k in level.tolist()])

    def dithered(self, joint: int) -> dict[Configuration, Index]:
        """Return the dithered torques of each configuration of a joint."""
        out: dict[Configuration, list[int]] = {}
        for i in self.of_joint[joint].tolist():
            if not self.base[i]:
                out.setdefault(self.jobs[i].configuration, []).append(i)
        return {where: np.array(rows) for where, rows in out.items()}

    def place(self, i: int) -> str:
        """Return joint, pose, direction and dither of a reading, as ``joint 7 load +, 30 Hz``."""
        job, where = self.jobs[i], self.jobs[i].configuration
        dither = f"{job.frequency_hz:g} Hz, {job.amplitude_nm:.4g} N·m"
        place = f"joint {where.joint} {where.load} {where.direction}"
        return f"{place}, {'no dither' if self.base[i] else dither}"


@dataclass(frozen=True, eq=False)
class Effect:
    """What a cause changes in some readings, by one unknown x that is 0 in the nominal model.

    x is the logarithm of a `quantity` of the simulation over its nominal value, the size of a
    `torque` that is added, or what `level` turns into a factor on friction.
    """

    cause: str
    joints: tuple[int, ...]
    """From 1; several only for a quantity that they have in common."""
    rows: Index
    """The readings."""
    _: KW_ONLY
    scope: str = ""
    """Which of the effects of this cause on a joint it is."""
    size: float
    """Standard deviation of the Gaussian prior of x."""
    most: float = np.inf
    """Largest |x|; ends of a quantity follow from what can be simulated."""
    trials: tuple[float, ...] = (-0.7, 0.7)
    """Values of x over its prior size to which the effect is a straight line [-]; assumed."""
    odds: float = 0.0
    """Log odds against it, beside those of one among the effects of its kind [nats]."""
    quantity: Quantity | None = None
    """What the simulation varies."""
    torque: Array | None = None
    """(rows,) torque that is added to the readings per unit of x."""
    level: Callable[[float], Array | float] | None = None
    """Returns the logarithm of the factor on friction, one or (rows,)."""
    parameters: Mapping[str, float]
    """The parameters of ``diagnosis.json`` per unit of x; a longer key names a part."""
    log: bool = False
    """Whether they are those per unit of exp(x)."""
    bad: bool = False
    """Whether it is a bad reading, and not a property of the arm."""

    def values(self, x: float) -> dict[str, float]:
        """Return the parameters of ``diagnosis.json`` for x."""
        each = float(np.exp(x)) if self.log else x
        return {name: scale * each for name, scale in self.parameters.items()}
