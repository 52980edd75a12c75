"""A dead zone where the transmitted torque changes sign: in the gap the motor drives no link."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape, log_grid
from stiction_envs.gap.logs.causes.deflection import mass_matrix, torque_of
from stiction_envs.gap.logs.data import Data


def crossings(data: Data, joint: int, gap: float) -> Array:
    """Return (T,) the link's angle less the motor's, δ, in a joint with a gap [rad].

    The load L presses the link on one flank, δ = ∓gap/2. When L changes sign the link flies,
    M δ̈ = −L, until δ has crossed the gap. Derived here; landing without rebound is assumed.
    """
    load = data.rigid[:, joint]
    mass = mass_matrix(data)[:, joint, joint]
    out, dt = np.zeros(len(load)), data.dt
    for run in data.runs():
        push, inertia = load[run], mass[run]
        sign = np.where(push >= 0, 1.0, -1.0)
        offset = -sign * gap / 2
        k = 0
        for turn in (np.flatnonzero(np.diff(sign)) + 1).tolist():
            if turn < k:
                continue
            # way across the gap, positive towards the other flank
            far = min(len(push), turn + round(FLIGHT / dt))
            pull = -push[turn:far] * sign[turn - 1]
            speed = np.cumsum(pull / inertia[turn:far]) * dt
            way = np.cumsum(speed) * dt
            landed = np.flatnonzero((way >= gap) | (way < 0))
            steps = int(landed[0]) if len(landed) else len(way)
            k = turn + steps
            offset[turn:k] = sign[turn - 1] * (np.clip(way[:steps], 0, gap) - gap / 2)
            # after a flight that fell back the link is on its old flank until the next turn
        out[run] = offset
    return out


FLIGHT = 2.0
"""Longest flight that is followed [s]; assumed."""


class Backlash(Cause):
    """Play in a gear."""

    name: ClassVar[str] = "backlash"
    what: ClassVar[str] = "dead zone at reversals"
    record: ClassVar[str] = "slow motion through the pose in which the joint's load changes sign"
    coupled: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("gap_rad", "rad", 0.0, size=1),)

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the gap adds to all joints."""
        return data.smooth(torque_of(data, joint, crossings(data, joint, shape[0])))[..., None]

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the gap adds to its own joint."""
        return self.spread(data, joint, shape)[:, joint]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return gaps [rad]."""
        return log_grid(2e-3, 0.1, 8)

    def bounds(self, data: Data) -> tuple[Array, Array]:
        """Return the model's own size, and some room for what it leaves out."""
        return np.array([0.5]), np.array([1.5])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the gap [rad]."""
        return {"gap_rad": shape[0]}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the load never changes sign."""
        turns = np.count_nonzero(np.diff(np.sign(data.rigid[:, joint])))
        return f"the load of joint {joint + 1} never changes sign" if turns < 3 else ""
