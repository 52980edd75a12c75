"""Logs of a robot after corrections: joint logs with torques, servo logs with commands."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.corrections import Correction


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLog:
    """Common part of all logs; arrays are float64 and read-only."""

    drive: ClassVar[str]
    """Drive of the joints: torque, or position."""
    source: str
    """File name as given."""
    t: Array
    """Time of each row on the robot's clock, strictly rising, (T,), s."""
    q: Array
    """Measured joint angles, (T, n), rad."""
    dq: Array | None
    """Joint speeds as logged, (T, n), rad/s; None where the log has none."""
    extra: dict[str, Array] = field(default_factory=dict)
    """Further channels: ``temperature`` [°C], ``tau_cmd`` [N·m], (T, n) each."""
    breaks: tuple[int, ...] = ()
    """First row of each segment but the first: where a gap or another recording begins."""
    held: int = 1
    """Most rows for which a channel holds one value: what is between them is interpolated."""
    corrections: tuple[Correction, ...] = ()
    warnings: tuple[str, ...] = ()
    """Defects that were found and not corrected, a sentence each."""
    date: float | None = None
    """Date that was taken off ``t``, s; None where times are no dates."""

    def __post_init__(self) -> None:
        for array in (*self.arrays, *self.extra.values()):
            if array is not None:
                array.flags.writeable = False

    @property
    def arrays(self) -> tuple[Array | None, ...]:
        """Time and what was logged with every row."""
        return (self.t, self.q, self.dq)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @property
    def step(self) -> float:
        """Usual time between rows, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def segments(self) -> tuple[slice, ...]:
        """Rows of each segment."""
        bounds = (0, *self.breaks, len(self.t))
        return tuple(slice(a, b) for a, b in pairwise(bounds))


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLog(RobotLog):
    """A log of joints that torque drives."""

    tau: Array
    """Joint torques, (T, n), N·m."""
    static: bool = False
    """Whether the rows are poses at rest without order in time; then ``t`` counts them."""
    side: str | None = None
    """Side of the gear on which ``tau`` was measured, where the file says it: motor or link."""
    drive: ClassVar = TORQUE

    @property
    def arrays(self) -> tuple[Array | None, ...]:
        return (self.t, self.q, self.dq, self.tau)


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoLog(RobotLog):
    """A log of joints that a position servo drives."""

    q_cmd: Array
    """Commanded joint angles, (T, n), rad."""
    tau: Array | None = None
    """Joint torques, (T, n), N·m; None where the log has none."""
    current: Array | None = None
    """Size of the motors' currents, (T, n), in a unit that need not be known: a witness of contact
    and saturation, not a torque. None where the log has none."""
    drive: ClassVar = POSITION

    @property
    def arrays(self) -> tuple[Array | None, ...]:
        return (self.t, self.q, self.dq, self.q_cmd, self.tau, self.current)
