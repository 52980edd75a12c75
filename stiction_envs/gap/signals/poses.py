"""Poses at rest: they have no order in time, and friction may hold any torque at each of them.

A joint at rest can hold any torque inside its friction band. Repeated poses show the scatter:
poses that are nearly the same differ only by noise and friction. A joint that rests throughout a
log while others move is held by friction in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stiction_envs.gap.signals.prepare import Segment

Array = NDArray[np.float64]
LEAST_PAIRS = 10
"""Least number of pairs of such poses for an estimate of the scatter [-]; assumed."""


def segment_numbers(parts: Sequence[Segment], dt: float) -> NDArray[np.int64]:
    """Return (T,) the number of the segment of each row; each pose is a segment of its own.

    ``dt`` is the time between samples of segments with motion [s].
    """
    out: list[NDArray[np.int64]] = []
    start = 0
    for s in parts:
        # poses have numbers instead of times
        timed = len(s.t) < 2 or not s.static or bool(np.isclose(s.t[1] - s.t[0], dt))
        out.append(np.full(len(s.t), start) if timed else start + np.arange(len(s.t)))
        start = int(out[-1][-1]) + 1
    return np.concatenate(out)


def scatter(q: Array, residual: Array, same_pose: float) -> Array | None:
    """Return (n,) scatter of the residual between equal poses [N·m], if there are any.

    Args:
        q: (T, n) [rad].
        residual: (T, n) measured less nominal torque [N·m].
        same_pose: as of `NoiseSettings` [rad].
    """
    if len(q) < 2:
        return None
    distance, nearest = cKDTree(q).query(q, k=2)
    first = np.flatnonzero(distance[:, 1] < same_pose)
    pairs = np.unique(np.sort(np.stack([first, nearest[first, 1]], axis=1), axis=1), axis=0)
    if len(pairs) < LEAST_PAIRS:
        return None
    difference = residual[pairs[:, 0]] - residual[pairs[:, 1]]
    return np.asarray(np.sqrt(np.mean(np.square(difference), axis=0) / 2))


def wander(q: Array, residual: Array, rigid: Array, least: float) -> Array:
    """Return (n,) scatter of joints that never move [N·m], after an offset and a scale; else 0.

    Sensors see their torque creep within the friction band, far below the sensors' own noise in
    frequency: it does not show what a simulation gets wrong.

    Args:
        q: (T, n) [rad].
        residual: (T, n) measured less nominal torque [N·m].
        rigid: (T, n) torque of the rigid body, which others' motion changes [N·m].
        least: angle that a joint must turn to count as moving [rad].
    """
    out = np.zeros(q.shape[1])
    for j in np.flatnonzero(np.ptp(q, axis=0) < least):
        x = np.stack([np.ones(len(q)), rigid[:, j]], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        out[j] = left.std()
    return out
