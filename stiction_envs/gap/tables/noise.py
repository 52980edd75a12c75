"""Noise of torque tables, and how likely a residual is.

Friction level and offset are known from the base torques only, within their noise. Each pose of
each joint therefore has a level and an offset that every fit adjusts: a base torque that was read
1 % high must not look like an effect on all dithered torques.

Losses are minus log likelihoods: Student's t for dithered torques, which limits the weight of a bad
reading, and normal (Huber from 4 sd) for base torques, which have no neighbours to compare.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.tables.readings import Readings
from stiction_envs.gap.tables.settings import ReadingNoiseSettings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
ROUNDS = 8
"""Rounds of iteratively reweighted least squares for levels and offsets; assumed."""
DRAWS = 30
"""Draws of pure noise that show how much of it medians and differences leave; assumed."""
LEAST_PAIRS = 8
"""Least number of readings, and of neighbours in amplitude, that show the noise; assumed."""
CLEARLY_LESS = 0.7
"""Noise from neighbours over that from medians below which they do not differ by chance [-];
assumed."""


def noise_of(readings: Readings, residual: Array, settings: ReadingNoiseSettings) -> Array:
    """Return (N,) standard deviation of a reading, per joint, from what no effect can explain.

    An effect changes all four configurations of a joint alike, or all blocks of a configuration.
    The residual after medians of both are subtracted is noise. An effect that differs strongly by
    configuration remains in it; then the differences between neighbours in amplitude show the
    noise. NaN where no joint has enough blocks.

    Args:
        readings: N readings.
        residual: (N,) residual over friction [-].
        settings: constants of the method.
    """
    rng = np.random.default_rng(0)
    found: dict[int, float] = {}
    for joint in readings.joints:
        rows = readings.of_joints([joint])
        some = [readings.all[i] for i in rows]
        wheres = sorted({r.where for r in some})
        at = np.array([wheres.index(r.where) for r in some]), readings.block[rows]
        if len(set(at[1])) < 3 or len(rows) < LEAST_PAIRS:
            continue
        order = sorted(
            range(len(rows)), key=lambda i: (some[i].where, some[i].frequency, some[i].amplitude)
        )
        pairs = np.array(
            [
                (i, k)
                for i, k in pairwise(order)
                if (some[i].where, some[i].frequency) == (some[k].where, some[k].frequency)
            ],
            dtype=np.int64,
        ).reshape(-1, 2)
        # medians and differences change noise too, by as much as pure noise of the same pattern
        pure = [rng.normal(size=len(rows)) for _ in range(DRAWS)]
        scale = np.mean([_size(_polished(v, at)) for v in pure])
        found[joint] = float(_size(_polished(residual[rows], at)) / scale)
        if len(pairs) >= LEAST_PAIRS:
            scale = np.mean([_size(v[pairs[:, 1]] - v[pairs[:, 0]]) for v in pure])
            change = residual[rows][pairs[:, 1]] - residual[rows][pairs[:, 0]]
            value = float(_size(change) / scale)
            if value < CLEARLY_LESS * found[joint]:
                found[joint] = value
    out = np.full(len(readings.all), np.nan)
    if found:
        # a single joint has few readings: a third of its variance is that of all joints
        pooled = float(np.median(list(found.values())))
        for joint in readings.joints:
            mixed = np.sqrt((2 * found.get(joint, pooled) ** 2 + pooled**2) / 3)
            out[readings.of_joints([joint])] = max(float(mixed), settings.least_sd)
        out[readings.base] = np.maximum(out[readings.base], settings.base_sd)
    return out


def _polished(values: Array, at: tuple[Index, Index]) -> Array:
    """Return what remains after row and column medians are subtracted, without zeros."""
    v = values.copy()
    for _ in range(3):
        for index in at:
            for k in np.unique(index):
                some = index == k
                if some.sum() > 1:
                    v[some] -= np.median(v[some])
    return v[v != 0.0]


def _size(values: Array) -> float:
    """Return the root mean square, with values clipped at four times the median."""
    if not len(values):
        return 0.0
    edge = 4.0 * np.median(np.abs(values))
    return float(np.sqrt((np.clip(values, -edge, edge) ** 2).mean()))


def losses(z: Array, base: Mask, settings: ReadingNoiseSettings) -> Array:
    """Return minus log likelihood of residuals over noise, up to a constant [nats].

    Args:
        z: (..., N) residuals over noise.
        base: (N,) which are base torques.
        settings: constants of the method.
    """
    a, freedom, huber = np.abs(z), settings.freedom, settings.huber
    student = (freedom + 1) / 2 * np.log1p(z * z / freedom)
    return np.where(base, np.where(a < huber, z * z / 2, huber * (a - huber / 2)), student)


def levelled(
    z: Array,
    slope: Array,
    shift: Array,
    level: Index,
    base: Mask,
    used: Mask,
    settings: ReadingNoiseSettings,
) -> tuple[Array, Array]:
    """Return residuals (m, N) after friction levels and offsets are adjusted, and its loss (m,).

    Args:
        z: (m, N) residuals over noise.
        slope: (N,) change of a reading over noise per relative change of its friction level.
        shift: (N,) the same per offset over friction.
        level: (N,) number of the level and offset of a reading, from 0.
        base: (N,) which are base torques.
        used: (N,) which readings the adjustment may use.
        settings: constants of the method.
    """
    s = settings
    freedom, huber = s.freedom, s.huber
    which = (level[:, None] == np.arange(int(level.max()) + 1)).astype(float)  # (N, levels)
    left, cost = z, np.zeros(len(z))
    for _ in range(ROUNDS):
        a = np.abs(left)
        weight = np.where(base, huber / np.maximum(a, huber), (freedom + 1) / (freedom + a * a))
        weight = weight * used
        # two unknowns per level: normal equations with the priors on their diagonal
        aa = (weight * slope**2) @ which + s.level_sd**-2
        bb = (weight * shift**2) @ which + s.offset_sd**-2
        ab = (weight * slope * shift) @ which
        za, zb = (weight * z * slope) @ which, (weight * z * shift) @ which
        determinant = aa * bb - ab * ab
        relative = (bb * za - ab * zb) / determinant
        offset = (aa * zb - ab * za) / determinant
        left = z - (relative @ which.T) * slope - (offset @ which.T) * shift
        cost = (relative**2).sum(axis=1) / (2 * s.level_sd**2)
        cost = cost + (offset**2).sum(axis=1) / (2 * s.offset_sd**2)
    return left, cost
