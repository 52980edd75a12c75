"""A dead zone where the transmitted torque changes sign: in the gap the motor drives no link."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

import numpy as np

from stiction_envs.gap.logs.causes.base import Array, Cause, Parameter, Shape, along_runs
from stiction_envs.gap.logs.causes.deflection import gravity_slope, mass_matrix, torque_of
from stiction_envs.gap.logs.data import Data

GAPS = np.geomspace(2e-3, 0.1, 25)
"""Gaps that are tried [rad]; assumed."""
FLANK = 1e4
"""Stiffness of a gear's flanks [N·m/rad]: harmonic drives of 100 N·m and more have as much
(assumed)."""
DAMPINGS = (0.3, 1.0)
"""Damping ratios of a link that strikes a flank, that are tried [-]; assumed: the motor gives way,
and takes up much of the blow."""
DRAGGED = 0.0
"""In the place of a damping ratio: the link stays where friction holds it while the motor crosses
the gap after a reversal, and all of the load is missing."""
BEST = 4
"""Shapes that go on to the selection."""
LEFT = 2.0
"""Times the noise floor that a joint's residual must exceed for a search [-]; assumed."""


def crossings(data: Data, joint: int, gap: float, damping: float = 0.3) -> Array:
    """Return (T,) the link's angle less the motor's, δ, in a joint with a gap [rad].

    The load L presses the link on one flank of stiffness K, which yields. When L changes sign the
    link flies over to the other flank, and comes back from it:
    M δ̈ = −L, and beyond the gap −L − K(δ ∓ gap/2) − Dδ̇. Derived here.
    """
    mass = mass_matrix(data)[:, joint, joint]
    h, half = data.dt, gap / 2
    out = np.zeros(len(mass))
    for run in data.runs():
        inertia = mass[run]
        pull = -data.rigid[run, joint] / inertia
        rows = zip(
            pull.tolist(),
            (FLANK / inertia).tolist(),
            (2 * damping * np.sqrt(FLANK / inertia)).tolist(),
            strict=True,
        )
        x, u, part = np.sign(pull[0]) * half + float(pull[0] * inertia[0]) / FLANK, 0.0, []
        for a, k, d in rows:
            over = x - half if x > half else x + half if x < -half else 0.0
            # the flank and its damping implicitly, so that stiff ones stay stable
            u = (u + h * (a - k * over)) / (1.0 + h * d + h * h * k) if over else u + h * a
            x += h * u
            part.append(x)
        out[run] = part
    return out


def all_crossings(data: Data, joint: int, gaps: Array, damping: float) -> Array:
    """Return (T, k) `crossings` of k gaps at once."""
    mass = mass_matrix(data)[:, joint, joint]
    h, half = data.dt, gaps / 2
    out = np.zeros((len(mass), len(gaps)))
    for run in data.runs():
        pull, stiff = -data.rigid[run, joint] / mass[run], FLANK / mass[run]
        loss = 1.0 + h * 2 * damping * np.sqrt(stiff) + h * h * stiff
        part = out[run]
        x, u = np.sign(pull[0]) * half + float(pull[0] * mass[run.start]) / FLANK, 0.0 * half
        rows = zip(pull.tolist(), stiff.tolist(), loss.tolist(), strict=True)
        for i, (a, k, d) in enumerate(rows):
            over = x - np.minimum(np.maximum(x, -half), half)
            u = u + h * (a - k * over)
            u = np.where(over != 0.0, u / d, u)
            x = x + h * u
            part[i] = x
    return out


def dragged(data: Data, joint: int, gap: float) -> Array:
    """Return (T,) part of the load, −1 or 0, that is missing after reversals of the motor."""
    way, out = data.way[:, joint], np.zeros(len(data.q))
    for run in data.runs():
        x = way[run]
        side = np.sign(np.diff(x))
        moves = np.flatnonzero(side)
        turns = moves[1:][side[moves[1:]] != side[moves[:-1]]]
        part = np.zeros(len(x))
        for a, b in pairwise([*turns, len(x) - 1]):
            part[a + 1 : b + 1] = np.where(np.abs(x[a + 1 : b + 1] - x[a]) < gap, -1.0, 0.0)
        out[run] = part
    return out


class Backlash(Cause):
    """Play in a gear."""

    name: ClassVar[str] = "backlash"
    what: ClassVar[str] = "dead zone at reversals"
    rough: ClassVar[bool] = True
    plain: ClassVar[bool] = False
    record: ClassVar[str] = "slow motion through the pose in which the joint's load changes sign"
    coupled: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("gap_rad", "rad", 0.0, size=1),)

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the gap adds to all joints."""
        gap, damping = (*shape, DAMPINGS[0])[:2]
        if damping == DRAGGED:
            torque = np.zeros_like(data.q)
            torque[:, joint] = data.rigid[:, joint] * dragged(data, joint, gap)
        else:
            torque = torque_of(data, joint, crossings(data, joint, gap, damping))
        return data.smooth(torque)[..., None]

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the gap adds to its own joint."""
        return self.spread(data, joint, shape)[:, joint]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the gaps and dampings that the residual of the joint itself shows best."""
        ok = data.block >= 0
        if residual[ok].std() < LEFT * data.noise[joint]:
            return []
        tried = [(damping, self._all(data, joint, damping)) for damping in (*DAMPINGS, DRAGGED)]
        scored = []
        for damping, columns in tried:
            size, along = np.square(columns[ok]).sum(axis=0), columns[ok].T @ residual[ok]
            c = np.clip(along / np.maximum(size, 1e-300), 0.3, 1.5)
            left = c * c * size - 2 * c * along
            scored += [(float(x), float(g), damping) for x, g in zip(left, GAPS, strict=True)]
        return [(gap, damping) for _, gap, damping in sorted(scored)[:BEST]]

    def _all(self, data: Data, joint: int, damping: float) -> Array:
        """Return (T, k) what all `GAPS` add to their own joint."""
        if damping == DRAGGED:
            missing = np.stack([dragged(data, joint, float(g)) for g in GAPS], axis=1)
            return data.smooth(data.rigid[:, joint, None] * missing)
        delta = all_crossings(data, joint, GAPS, damping)
        bend = along_runs(data, along_runs(data, delta))
        torque = mass_matrix(data)[:, joint, joint, None] * bend
        return data.smooth(torque + gravity_slope(data)[:, joint, joint, None] * delta)

    def between(self, shape: Shape, shapes: list[Shape]) -> tuple[float, float]:
        """Return the neighbours on the grid of gaps."""
        step = float(GAPS[1] / GAPS[0])
        return shape[0] / step, shape[0] * step

    def at_edge(self, shape: Shape, shapes: list[Shape]) -> bool:
        """Return whether the gap is at the end of what was tried."""
        return not GAPS[0] * 1.001 < shape[0] < GAPS[-1] * 0.999

    def bounds(self, data: Data) -> tuple[Array, Array]:
        """Return the model's own size, and some room for what it leaves out."""
        return np.array([0.3]), np.array([1.5])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the gap [rad]."""
        return {"gap_rad": shape[0]}

    def lacking(self, data: Data, joint: int) -> str:
        """Return whether nothing turns."""
        loads = np.count_nonzero(np.diff(np.sign(data.rigid[:, joint])))
        turns = np.count_nonzero(np.diff(np.sign(np.round(data.dq[:, joint] / 0.01))))
        if loads < 3 and turns < 4:
            return f"neither motion nor load of joint {joint + 1} changes sign"
        return ""
