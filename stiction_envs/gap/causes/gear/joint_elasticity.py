"""A spring between motor and link: the link is τ/K behind the measured motor angle."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Index
from stiction_envs.compiled import compiled
from stiction_envs.gap.causes.base import (
    ALL_OF_ONE,
    Array,
    Cause,
    Columns,
    Parameter,
    Prior,
    Shape,
)
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import gravity_slopes, mass_matrices

DAMPINGS = (0.01, 0.03, 0.1, 0.3)
"""Damping ratios of the link on its spring to try [-]; assumed."""
BEST = 6
"""Number of shapes that go on to the selection; assumed."""
LEAST_ROTOR = 0.01
"""Least rotor inertia that can carry a joint's friction in front of a spring [kg·m²]; assumed."""
SPRINGS = 20
"""Number of springs that are simulated at once: more take memory without saving time; assumed."""
TRIED = np.geomspace(500.0, 32000.0, 25)
"""Stiffnesses to try [N·m/rad]; assumed: soft harmonic drives to stiff gears."""
LEAST, MOST = 0.3, 1.5
"""Bounds of the torque over what a tried stiffness predicts [-]; assumed: room for stiffnesses
between those tried."""


class JointElasticity(Cause):
    """A link that swings on K: M δ̈ + D δ̇ + K δ = −load, Δτ = M[:, j] δ̈ + ∂g/∂q[:, j] δ.

    The coefficient is the size of the torque over what a tried stiffness predicts.
    """

    name: ClassVar[str] = "joint_elasticity"
    what: ClassVar[str] = "spring between motor and link"
    what_to_record: ClassVar[str] = (
        "a sweep through 1 to 20 Hz of each joint, motor and link angle logged"
    )
    parameters: ClassVar = (Parameter("stiffness_nm_per_rad", "N·m/rad", 0.0),)
    resembles_delay: ClassVar[bool] = True
    filtered: ClassVar[bool] = False
    is_linear: ClassVar[bool] = False
    acts_on: ClassVar[str] = ALL_OF_ONE

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return all of what is predicted [-], and the least and the largest coefficient."""
        return Prior(np.ones(1), np.array([LEAST]), np.array([MOST]))

    def grid(self, data: Data, joint: int) -> Array:
        """Return the stiffnesses to try [N·m/rad]."""
        return TRIED

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque of the link's deflection on all joints."""
        spring = (*shape, DAMPINGS[2])[:2]  # a model file may hold the stiffness alone
        delta = deflections(data, joint, [spring])[:, 0]
        return torque_of(data, joint, delta)[..., None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the stiffnesses [N·m/rad] and damping ratios that the residual shows best."""
        ok = data.block >= 0
        tried = [(float(k), ratio) for ratio in DAMPINGS for k in TRIED]
        left = []
        for at in range(0, len(tried), SPRINGS):
            delta = deflections(data, joint, tried[at : at + SPRINGS])
            columns = data.smooth(own_torque_of(data, joint, delta))[ok]
            along, size = residual[ok] @ columns, np.square(columns).sum(axis=0)
            c = np.clip(along / np.maximum(size, 1e-300), LEAST, MOST)
            left.append(c * c * size - 2 * c * along)
        return [tried[k] for k in np.argsort(np.concatenate(left), kind="stable")[:BEST]]

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether more than hardly any of its torque is in the logs.

        The upper bound is none: a motion without the resonance asks for a stiffer spring of more
        than its size, and K is then the size of the deflection only.
        """
        return bool(coefficients[0] > LEAST)

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return K [N·m/rad]."""
        return {"stiffness_nm_per_rad": shape[0] / float(coefficients[0])}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Make the joint elastic if its rotor inertia is known."""
        j, springs = part.joint - 1, draft.values["joint_stiffness"]
        if draft.values["rotor_inertia"][j] >= LEAST_ROTOR and not np.isfinite(springs[j]):
            springs[j] = max(1.0, part.shape[0] / part.coefficients[0])
        else:
            draft.leave_out(part, "no rotor inertia is known that could swing on the spring")


def masses(recording: Recording) -> Columns:
    """Return (T, n, n) M(q) of an arm along a recording [kg·m²]."""
    return mass_matrices(recording.pinocchio, recording.q).astype(np.float32)


def slopes(recording: Recording) -> Columns:
    """Return (T, n, n) ∂g/∂q of an arm along a recording [N·m/rad]."""
    return gravity_slopes(recording.pinocchio, recording.q).astype(np.float32)


def own_terms(data: Data, joint: int) -> tuple[Array, Array]:
    """Return (T,) inertia [kg·m²] and slope of gravity [N·m/rad] of a joint on itself."""
    mass, slope = (data.links.derived(x)[:, joint, joint] for x in (masses, slopes))
    return mass.astype(np.float64), slope.astype(np.float64)


def torque_of(data: Data, joint: int, deflection: Array) -> Array:
    """Return (T, n) M[:, j] δ̈ + ∂g/∂q[:, j] δ of a link that is δ (T,) off its motor [N·m].

    First order in δ; Coriolis terms of δ̇ are left out.
    """
    bend = data.rate(data.rate(deflection))
    mass, slope = (data.links.derived(x)[:, :, joint] for x in (masses, slopes))
    return np.asarray(mass * bend[:, None] + slope * deflection[:, None])


def own_torque_of(data: Data, joint: int, deflections: Array) -> Array:
    """Return (T, k) `torque_of` k deflections (T, k) on the joint itself [N·m]."""
    bend = data.rate(data.rate(deflections))
    mass, slope = own_terms(data, joint)
    bend *= mass[:, None]
    bend += slope[:, None] * deflections
    return bend


def deflections(data: Data, joint: int, springs: Sequence[Shape]) -> Array:
    """Return (T, k) the link's angle less the motor's, M δ̈ + D δ̇ + K δ = −load(q + δ) [rad].

    Newmark's average acceleration, which is stable for any K ("A method of computation for
    structural dynamics", 1959); D is a part of the critical. The load is that of the motor's
    angle and its slope with gravity, to first order in δ. Each of the k springs is its stiffness
    and its damping ratio.
    """
    loads = data.rigid[:, joint], *own_terms(data, joint)
    stiffness, ratio = np.array(springs).T
    return _swing(*loads, data.recording.segment, stiffness, ratio, data.dt)


@compiled
def _swing(
    load: Array,
    mass: Array,
    slope: Array,
    segment: Index,
    stiffness: Array,
    ratio: Array,
    h: float,
) -> Array:
    """Return `deflections` (T, k), in each segment from rest."""
    springs = len(stiffness)
    out = np.empty((len(load), springs))
    x, v, a = np.empty(springs), np.empty(springs), np.empty(springs)
    for k in range(len(load)):
        if k == 0 or segment[k] != segment[k - 1]:
            for s in range(springs):
                x[s] = -load[k] / max(stiffness[s] + slope[k], 0.1 * stiffness[s])
                v[s], a[s] = 0.0, 0.0
        for s in range(springs):  # inside: the processor takes several springs at once
            total = max(stiffness[s] + slope[k], 0.1 * stiffness[s])
            damping = 2 * ratio[s] * np.sqrt(stiffness[s] * mass[k])
            ahead, faster = x[s] + h * v[s] + h * h * a[s] / 4, v[s] + h * a[s] / 2
            force = -load[k] - damping * faster - total * ahead
            a[s] = force / (mass[k] + damping * h / 2 + total * h * h / 4)
            x[s], v[s] = ahead + h * h * a[s] / 4, faster + h * a[s] / 2
            out[k, s] = x[s]
    return out
