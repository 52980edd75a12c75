"""A dead zone where the transmitted torque changes sign: in the gap the motor drives no link."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.gap.causes.base import Array, Parameter, Shape, View, variable
from stiction_envs.gap.causes.gear.deflection import (
    DeflectedLink,
    own_terms,
    own_torque_of,
    seen_by,
    torque_of,
)
from stiction_envs.gap.causes.motion import rests, reversals
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.reversal_path import play

DRAGGED, LOST = 0.0, -1.0
"""Used in place of a damping ratio for links that friction holds while the motor crosses the gap
after a reversal: the gear carries no load, or the link only stays behind."""
AT_ONCE = 32
"""Number of gaps that are simulated at once: more take memory without saving time; assumed."""
SIZED = 8
"""Step on the grid of gaps at which the size of their torque is computed, since it changes slowly;
assumed."""
FLANK = 10000.0
"""Stiffness of a gear's flanks [N·m/rad]; assumed: harmonic drives of 100 N·m and more have as
much."""
DAMPINGS = (0.05, 0.1, 0.2, 0.4, 1.0)
"""Damping ratios that are tried of a link that strikes a flank [-]; assumed: the motor yields and
absorbs much of the blow."""
USUAL_DAMPING = 0.2
"""Damping ratio where none is known [-]; assumed."""
BEST = 6
"""Number of shapes that go on to the selection; assumed."""
FLANKS = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Stiffnesses over `FLANK` that the interval of a gap allows for [-], since a gap looks wider with
a softer flank; assumed: known to a factor of two."""
PROFILE_REACH = 1.35
"""Largest factor from the gap that was found to those tried for its interval [-]; assumed."""
PROFILE_COUNT = 31
"""Number of gaps that are tried for the interval; assumed."""
RESIDUAL_LEFT = 2.0
"""Least residual of a joint over the noise floor for a search [-]; assumed."""


def crossings(data: Data, joint: int, gaps: Array, damping: float, flank: float) -> Array:
    """Return (T, K) the link's angle less the motor's, δ, in a joint with each of K gaps [rad].

    The load L presses the link on one flank of stiffness K, which yields. When L changes sign, the
    link flies to the other flank and bounces: M δ̈ = −L in the gap, and −L − K(δ ∓ gap/2) − Dδ̇
    beyond it. L is the load at the motor's angle, with its gravity slope to first order in δ.
    Derived here.
    """
    mass, slope = own_terms(data, joint)
    loads = data.rigid[:, joint], slope, mass
    return _fly(*loads, data.recording.segment, gaps / 2, damping, flank, data.dt)


@compiled
def _fly(
    load: Array,
    slope: Array,
    mass: Array,
    segment: NDArray[np.int64],
    half: Array,
    ratio: float,
    flank: float,
    h: float,
) -> Array:
    """Return `crossings` (T, K), in each segment from rest on the flank.

    Velocity Verlet in flight, exact for a load that is constant over a sample; implicit Euler on
    the flank, stable for any stiffness.
    """
    out, x, u = np.empty((len(load), len(half))), np.empty(len(half)), np.empty(len(half))
    for i in range(len(load)):
        if i == 0 or segment[i] != segment[i - 1]:
            for g in range(len(half)):
                x[g], u[g] = -np.sign(load[i]) * half[g] - load[i] / flank, 0.0
                out[i, g] = x[g]
            continue
        k = flank / mass[i]
        damped = 1.0 + h * 2 * ratio * np.sqrt(k) + h * h * k
        for g in range(len(half)):  # inside: the processor takes several gaps at once
            over = x[g] - min(max(x[g], -half[g]), half[g])
            before = -(load[i - 1] + slope[i - 1] * x[g]) / mass[i - 1]
            fly = x[g] + h * u[g] + 0.5 * h * h * before
            after = -(load[i] + slope[i] * fly) / mass[i]
            press = (u[g] + h * (-(load[i] + slope[i] * x[g]) / mass[i] - k * over)) / damped
            free = over == 0.0
            u[g] = u[g] + 0.5 * h * (before + after) if free else press
            x[g] = fly if free else x[g] + h * press
            out[i, g] = x[g]
    return out


def dragged(data: Data, joint: int, gaps: Array) -> Array:
    """Return (T, K) part of the load, −1 or 0, that K gaps miss after reversals of the motor."""
    return _missing(data.reversal_path[:, joint], data.recording.segment, gaps)


@compiled
def _missing(path: Array, segment: NDArray[np.int64], gaps: Array) -> Array:
    """Return `dragged` (T, K)."""
    out = np.zeros((len(path), len(gaps)))
    side, turn, turned = 0.0, 0.0, False
    for i in range(1, len(path)):
        if segment[i] != segment[i - 1]:
            side, turned = 0.0, False
            continue
        step = np.sign(path[i] - path[i - 1])
        if step != 0.0 and step != side:
            if side != 0.0:
                turn, turned = path[i - 1], True
            side = step
        if turned:
            way = abs(path[i] - turn)
            for g in range(len(gaps)):
                out[i, g] = -1.0 if way < gaps[g] else 0.0
    return out


def lost(data: Data, joint: int, gaps: Array) -> Array:
    """Return (T, K) the link's angle less the motor's where friction holds the link [rad].

    The motor drags it along with a play of each of K gaps, as in Tao and Kokotović, "Adaptive
    control of systems with actuator and sensor nonlinearities", 1996.
    """
    out = np.zeros((len(data.q), len(gaps)))
    for run in (x for x in data.runs() if x.stop - x.start > 1):
        path = data.reversal_path[run, joint]
        out[run] = play(path, gaps / 2) - path[:, None]
    return out


class Backlash(DeflectedLink):
    """Play in a gear."""

    name: ClassVar[str] = "backlash"
    what: ClassVar[str] = "dead zone at reversals"
    what_to_record: ClassVar[str] = (
        "slow motion through the pose in which the joint's load changes sign"
    )
    parameters: ClassVar = (Parameter("gap_rad", "rad", 0.0, size=1),)
    view: ClassVar = View(
        "transmitted torque [N·m]", variable("rigid"), note="a dent about zero load"
    )
    tried: ClassVar[Array] = np.geomspace(0.002, 0.1, 161)
    """Gaps [rad]; assumed. They are 2.5 % apart, because the time at which a link lands depends on
    the gap, and with it the blows of a fast motion."""
    least: ClassVar[float] = 0.2
    """Assumed; blows that are predicted a little early or late count less."""
    most: ClassVar[float] = 1.5
    """Assumed."""

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the gap adds to all joints."""
        gap, damping = (*shape, USUAL_DAMPING)[:2]
        if damping == DRAGGED:
            torque = np.zeros_like(data.q)
            torque[:, joint] = data.rigid[:, joint] * dragged(data, joint, np.array([gap]))[:, 0]
        else:
            delta = self._deltas(data, joint, np.array([gap]), damping)[:, 0]
            torque = torque_of(data, joint, delta)
        return data.smooth(torque)[..., None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the gaps and dampings that the residual of the joint itself shows best."""
        ok, gaps = data.block >= 0, self.tried
        if residual[ok].std() < RESIDUAL_LEFT * data.noise[joint]:
            return []
        # the filter is symmetric: a product with what it leaves is one with the filtered residual
        target = data.smooth(np.where(ok, residual, 0.0))
        some = np.unique([*range(0, len(gaps), SIZED), len(gaps) - 1])
        scored = []
        # a link that friction holds stays behind only where the motor moves
        held = () if rests(data, joint) else (DRAGGED, LOST)
        seen = {DRAGGED: target * data.rigid[:, joint]}
        other = seen_by(data, joint, target)
        for damping in (*DAMPINGS, *held):
            along = np.concatenate(
                [
                    seen.get(damping, other)
                    @ self._deltas(data, joint, gaps[k : k + AT_ONCE], damping)
                    for k in range(0, len(gaps), AT_ONCE)
                ]
            )
            opened = self._deltas(data, joint, gaps[some], damping)
            torque = self._own(data, joint, opened, damping)
            size = np.square(data.smooth(torque)[ok]).sum(axis=0)
            size = np.interp(np.log(gaps), np.log(gaps[some]), size)
            left = self.left(along, size)
            scored += [(float(x), float(g), damping) for x, g in zip(left, gaps, strict=True)]
        return [(gap, damping) for _, gap, damping in sorted(scored)[:BEST]]

    def profile(
        self, data: Data, joint: int, shape: Shape, residual: Array, weight: Array
    ) -> tuple[Array, Array]:
        """Return gaps (K,) [rad] and the error left with each (K,), for the best flank and damping.

        Stiffness and damping of the flanks are unknown, and both change when the link lands.
        """
        damping = (*shape, USUAL_DAMPING)[1]
        gaps = shape[0] * np.geomspace(1 / PROFILE_REACH, PROFILE_REACH, PROFILE_COUNT)
        kinds = [(damping, FLANK)]
        if damping not in (DRAGGED, LOST):
            kinds = [(d, FLANK * f) for d in DAMPINGS for f in FLANKS]
        left = np.full(len(gaps), np.inf)
        for kind, flank in kinds:
            torque = self._own(data, joint, self._deltas(data, joint, gaps, kind, flank), kind)
            torque = data.smooth(torque)
            along, size = torque.T @ (weight * residual), np.square(torque).T @ weight
            left = np.minimum(left, self.left(along, size))
        return gaps, left + float(np.sum(weight * residual**2))

    def _deltas(
        self, data: Data, joint: int, gaps: Array, damping: float, flank: float | None = None
    ) -> Array:
        """Return (T, K) δ of K gaps [rad], or the missing part of the load of dragged links.

        ``flank`` is the stiffness of the flanks [N·m/rad]; None for `FLANK`.
        """
        if damping == DRAGGED:
            return dragged(data, joint, gaps)
        if damping == LOST:
            return lost(data, joint, gaps)
        return crossings(data, joint, gaps, damping, flank or FLANK)

    def _own(self, data: Data, joint: int, opened: Array, damping: float) -> Array:
        """Return (T, k) what `_deltas` of k gaps add to the joint itself, before the filter."""
        if damping == DRAGGED:
            return np.asarray(data.rigid[:, joint, None] * opened)
        return own_torque_of(data, joint, opened)

    def at_edge(self, shape: Shape, shapes: list[Shape], edge: float) -> bool:
        """Return whether the gap is at an end of what was tried, or next to it."""
        return not self.tried[1] * edge < shape[0] < self.tried[-2] / edge

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the gap [rad]."""
        return {"gap_rad": shape[0]}

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether neither motion nor load changes sign."""
        loads = reversals(data.rigid[:, joint], data.noise[joint])
        if loads < 3 and reversals(data.dq[:, joint], data.settings.motion.reversal_speed) < 2:
            return f"neither motion nor load of joint {joint + 1} changes sign"
        return ""
