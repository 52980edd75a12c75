"""A spring between motor and link: the link is τ/K behind the measured motor angle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.compiled import compiled
from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.gear.deflection import (
    gravity_slope,
    mass_matrix,
    own_torque_of,
    torque_of,
)
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.signals.dataset import Data

STIFFNESSES = np.geomspace(500.0, 32000.0, 25)
"""That are tried [N·m/rad]: soft harmonic drives to stiff gears."""
DAMPINGS = (0.01, 0.03, 0.1, 0.3)
"""Damping ratios of the link on its spring that are tried [-]."""
BEST = 6
"""Shapes that go on to the selection."""
LEAST = 0.3
"""Size of what comes over what the model predicts, at least [-]: room for stiffnesses between those
tried."""
MOST = 1.5
"""The same, at most [-]."""
LEAST_ROTOR = 0.01
"""Least rotor inertia that can carry a joint's friction in front of a spring [kg·m²]."""


SPRINGS = 20
"""That are moved at once: more take more memory than they save time."""


class JointElasticity(Cause):
    """A link that swings on K: M δ̈ + D δ̇ + K δ = −load, Δτ = M[:, j] δ̈ + ∂g/∂q[:, j] δ."""

    name: ClassVar[str] = "joint_elasticity"
    what: ClassVar[str] = "spring between motor and link"
    approximate: ClassVar[bool] = True
    resembles_delay: ClassVar[bool] = True
    is_linear: ClassVar[bool] = False
    what_to_record: ClassVar[str] = (
        "a sweep through 1 to 20 Hz of each joint, motor and link angle logged"
    )
    coupled: ClassVar[bool] = True
    dependent_parameters: ClassVar[int] = 1
    multimodal: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("stiffness_nm_per_rad", "N·m/rad", 0.0),)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque on the joint itself."""
        return self.spread(data, joint, shape)[:, joint]

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque of the link's deflection on all joints."""
        delta = deflection(data, joint, *shape)
        return data.smooth(torque_of(data, joint, delta))[..., None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the stiffnesses [N·m/rad] and damping ratios that the residual shows best."""
        ok = data.block >= 0
        tried = [(float(k), ratio) for ratio in DAMPINGS for k in STIFFNESSES]
        left = []
        for at in range(0, len(tried), SPRINGS):
            delta = deflections(data, joint, tried[at : at + SPRINGS])
            columns = data.smooth(own_torque_of(data, joint, delta))[ok]
            size, along = np.square(columns).sum(axis=0), residual[ok] @ columns
            c = np.clip(along / np.maximum(size, 1e-300), LEAST, MOST)
            left.append(c * c * size - 2 * c * along)
        return [tried[k] for k in np.argsort(np.concatenate(left), kind="stable")[:BEST]]

    def between(self, shape: Shape, shapes: list[Shape]) -> tuple[float, float]:
        """Return the neighbours on the grid of stiffnesses."""
        step = float(STIFFNESSES[1] / STIFFNESSES[0])
        return shape[0] / step, shape[0] * step

    def at_edge(self, shape: Shape, shapes: list[Shape], edge: float) -> bool:
        """Return whether the stiffness is at the end of what was tried."""
        return not STIFFNESSES[0] * 1.001 < shape[0] < STIFFNESSES[-1] * 0.999

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return the model's own size, and some room."""
        return np.array([LEAST]), np.array([MOST])

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Return whether next to nothing of it comes.

        A logged motion without the resonance asks for a stiffer spring of more than its size: K is
        then the size of the deflection alone.
        """
        return bool(coefficients[0] <= LEAST)

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return K [N·m/rad]."""
        return {"stiffness_nm_per_rad": shape[0] / float(coefficients[0])}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Make the joint elastic, where a rotor is known that can swing on the spring."""
        j = part.joint - 1
        if draft.rotor[j] >= LEAST_ROTOR and not np.isfinite(draft.spring[j]):
            draft.spring[j] = max(1.0, part.shape[0] / part.coefficients[0])
        else:
            draft.leave_out(part, "no rotor inertia is known that could swing on the spring")

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the joint's torque changes too little."""
        if float(data.rigid[:, joint].std()) < data.settings.noise.clear * data.noise[joint]:
            return f"joint {joint + 1} carries no torque that changes"
        return ""


def deflection(data: Data, joint: int, stiffness: float, ratio: float = 0.1) -> Array:
    """Return (T,) the link's angle less the motor's, M δ̈ + D δ̇ + K δ = −load(q + δ) [rad].

    Newmark's average acceleration, which is stable for any K ("A method of computation for
    structural dynamics", 1959); D is ``ratio`` of the critical. The load is that of the motor's
    angle and its slope with gravity, to first order in δ.
    """
    return deflections(data, joint, [(stiffness, ratio)])[:, 0]


def deflections(data: Data, joint: int, springs: Sequence[Shape]) -> Array:
    """Return (T, k) `deflection` of k springs, each its stiffness and damping ratio."""
    load, mass = data.rigid[:, joint], mass_matrix(data)[:, joint, joint]
    slope = gravity_slope(data)[:, joint, joint]
    stiffness, ratio = np.array(springs).T
    out = np.empty((len(load), len(stiffness)))
    for run in data.runs():
        _swing(load[run], mass[run], slope[run], stiffness, ratio, data.dt, out[run])
    return out


@compiled
def _swing(
    load: Array,
    mass: Array,
    slope: Array,
    stiffness: Array,
    ratio: Array,
    h: float,
    out: Array,
) -> None:
    """Put `deflections` of one run into ``out`` (T, k), from rest."""
    springs = len(stiffness)
    x, v, a = np.empty(springs), np.zeros(springs), np.zeros(springs)
    for s in range(springs):
        x[s] = -load[0] / max(stiffness[s] + slope[0], 0.1 * stiffness[s])
    for k in range(len(load)):
        for s in range(springs):  # inside: the processor takes several springs at once
            total = max(stiffness[s] + slope[k], 0.1 * stiffness[s])
            damping = 2 * ratio[s] * np.sqrt(stiffness[s] * mass[k])
            ahead, faster = x[s] + h * v[s] + h * h * a[s] / 4, v[s] + h * a[s] / 2
            force = -load[k] - damping * faster - total * ahead
            a[s] = force / (mass[k] + damping * h / 2 + total * h * h / 4)
            x[s], v[s] = ahead + h * h * a[s] / 4, faster + h * a[s] / 2
            out[k, s] = x[s]
