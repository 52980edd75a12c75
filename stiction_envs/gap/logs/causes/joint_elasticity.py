"""A spring between motor and link: the link is τ/K behind the measured motor angle."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape, log_grid
from stiction_envs.gap.logs.causes.deflection import mass_matrix, torque_of
from stiction_envs.gap.logs.data import Data


class JointElasticity(Cause):
    """A link that swings on K: M δ̈ + K δ = −load, Δτ = M[:, j] δ̈ + ∂g/∂q[:, j] δ."""

    name: ClassVar[str] = "joint_elasticity"
    what: ClassVar[str] = "spring between motor and link"
    rough: ClassVar[bool] = True
    plain: ClassVar[bool] = False
    record: ClassVar[str] = "a sweep through 1 to 20 Hz of each joint, motor and link angle logged"
    coupled: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("stiffness_nm_per_rad", "N·m/rad", 0.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque on the joint itself."""
        return self.spread(data, joint, shape)[:, joint]

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque of the link's deflection on all joints."""
        delta = deflection(data, joint, shape[0])
        return data.smooth(torque_of(data, joint, delta))[..., None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return stiffnesses [N·m/rad], soft harmonic drives to stiff gears."""
        return log_grid(500.0, 32000.0, 7)

    def bounds(self, data: Data) -> tuple[Array, Array]:
        """Return the model's own size, and room for stiffnesses between those tried."""
        return np.array([0.3]), np.array([1.5])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return K [N·m/rad]."""
        return {"stiffness_nm_per_rad": shape[0] / float(coefficients[0])}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether the joint's torque changes too little."""
        if float(data.rigid[:, joint].std()) < 5 * data.noise[joint]:
            return f"joint {joint + 1} carries no torque that changes"
        return ""


def deflection(data: Data, joint: int, stiffness: float) -> Array:
    """Return (T,) the link's angle less the motor's, M δ̈ + D δ̇ + K δ = −load(q) [rad].

    Newmark's average acceleration, which is stable for any K ("A method of computation for
    structural dynamics", 1959); D is `DAMPING` of the critical.
    """
    load, mass = data.rigid[:, joint], mass_matrix(data)[:, joint, joint]
    damping = 2 * DAMPING * np.sqrt(stiffness * mass)
    h = data.dt
    inverse = 1.0 / (mass + damping * h / 2 + stiffness * h * h / 4)
    out = np.zeros(len(load))
    for run in data.runs():
        x, v, a = -float(load[run.start]) / stiffness, 0.0, 0.0
        part = np.empty(run.stop - run.start)
        rows = zip(load[run].tolist(), damping[run].tolist(), inverse[run].tolist(), strict=True)
        for k, (pull, d, gain) in enumerate(rows):
            ahead, faster = x + h * v + h * h * a / 4, v + h * a / 2
            a = (-pull - d * faster - stiffness * ahead) * gain
            x, v = ahead + h * h * a / 4, faster + h * a / 2
            part[k] = x
        out[run] = part
    return out


DAMPING = 0.1
"""Damping ratio of a gear's spring [-]; assumed."""
