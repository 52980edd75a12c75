"""A link that is not where the motor is: what its deflection does to all joints' torques."""

from __future__ import annotations

import numpy as np

from stiction_envs.gap.causes.base import Array
from stiction_envs.gap.causes.motion import along_runs
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import gravity_slopes, mass_matrices


def mass_matrix(data: Data) -> Array:
    """Return (T, n, n) M(q) of the nominal arm [kg·m²]."""
    return masses(data.recording)


def gravity_slope(data: Data) -> Array:
    """Return (T, n, n) ∂g/∂q of the nominal arm [N·m/rad]."""
    return data.recording.derived(_slope)


def masses(recording: Recording) -> Array:
    """Return (T, n, n) M(q) of the nominal arm along a recording [kg·m²]."""
    return recording.derived(_masses)


def _masses(recording: Recording) -> Array:
    return mass_matrices(recording.pinocchio, recording.q)


def _slope(recording: Recording) -> Array:
    return gravity_slopes(recording.pinocchio, recording.q)


def torque_of(data: Data, joint: int, deflection: Array) -> Array:
    """Return (T, n) M[:, j] δ̈ + ∂g/∂q[:, j] δ of a link that is δ (T,) off its motor [N·m].

    First order in δ; Coriolis terms of δ̇ are left out.
    """
    bend = along_runs(data, along_runs(data, deflection))
    own, slope = mass_matrix(data)[:, :, joint], gravity_slope(data)[:, :, joint]
    return own * bend[:, None] + slope * deflection[:, None]


def seen_by(data: Data, joint: int, target: Array) -> Array:
    """Return (T,) w with which w @ δ = target @ `own_torque_of` δ, for any deflection δ (T,)."""
    own, slope = mass_matrix(data)[:, joint, joint], gravity_slope(data)[:, joint, joint]
    bent = own * target
    for _ in range(2):
        bent = _rate_transposed(bent, data.runs(), data.dt)
    return np.asarray(bent + slope * target)


def _rate_transposed(x: Array, runs: list[slice], dt: float) -> Array:
    """Return Dᵀx of the derivative D that `along_runs` takes: centred, one-sided at both ends."""
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


def own_torque_of(data: Data, joint: int, deflections: Array) -> Array:
    """Return (T, k) `torque_of` k deflections (T, k) on the joint itself [N·m]."""
    bend = along_runs(data, along_runs(data, deflections))
    own, slope = mass_matrix(data)[:, joint, joint], gravity_slope(data)[:, joint, joint]
    return np.asarray(own[:, None] * bend + slope[:, None] * deflections)
