"""A link that is not where the motor is: what its deflection does to all joints' torques."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import ALL_OF_ONE, Array, Cause, Columns, Prior, Shape
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording, rate
from stiction_envs.gap.signals.rigid_body import gravity_slopes, mass_matrices


class DeflectedLink(Cause):
    """A cause that moves a link relative to its motor, by a number that is tried.

    The coefficient is the size of the torque over what the cause predicts.
    """

    resembles_delay: ClassVar[bool] = True
    is_linear: ClassVar[bool] = False
    acts_on: ClassVar[str] = ALL_OF_ONE
    tried: ClassVar[Array]
    """Values of the nonlinear parameter that are tried, evenly in the logarithm."""
    least: ClassVar[float]
    """Least coefficient [-]."""
    most: ClassVar[float]
    """Largest coefficient [-]."""

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return all of what is predicted [-], and the least and the largest coefficient."""
        return Prior(np.ones(1), np.array([self.least]), np.array([self.most]))

    def grid(self, data: Data, joint: int) -> Array:
        """Return `tried`."""
        return self.tried

    def left(self, along: Array, size: Array) -> Array:
        """Return the squared error of columns, less that without them, with the best coefficient.

        Args:
            along: products of the columns with the residual.
            size: squared sums of the columns.
        """
        c = np.clip(along / np.maximum(size, 1e-300), self.least, self.most)
        return np.asarray(c * c * size - 2 * c * along)


def along_runs(data: Data, signal: Array) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    return rate(signal, data.runs(), data.dt)


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
    bend = along_runs(data, along_runs(data, deflection))
    mass, slope = (data.links.derived(x)[:, :, joint] for x in (masses, slopes))
    return np.asarray(mass * bend[:, None] + slope * deflection[:, None])


def own_torque_of(data: Data, joint: int, deflections: Array) -> Array:
    """Return (T, k) `torque_of` k deflections (T, k) on the joint itself [N·m]."""
    bend = along_runs(data, along_runs(data, deflections))
    mass, slope = own_terms(data, joint)
    bend *= mass[:, None]
    bend += slope[:, None] * deflections
    return bend


def seen_by(data: Data, joint: int, target: Array) -> Array:
    """Return (T,) w with which w @ δ = target @ `own_torque_of` δ, for any deflection δ (T,)."""
    mass, slope = own_terms(data, joint)
    bent = mass * target
    for _ in range(2):
        bent = _rate_transposed(bent, data.runs(), data.dt)
    return np.asarray(bent + slope * target)


def _rate_transposed(x: Array, runs: list[slice], dt: float) -> Array:
    """Return Dᵀx of the derivative D of `along_runs`: centred, one-sided at both ends."""
    out = np.zeros_like(x)
    for run in runs:
        if run.stop - run.start > 2:
            left = x[run] / (2 * dt)
            left[[0, -1]] *= 2
            out[run.start + 1 : run.stop] += left[:-1]
            out[run.start : run.stop - 1] -= left[1:]
            out[run.start] -= left[0]
            out[run.stop - 1] += left[-1]
    return out
