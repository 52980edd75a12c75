"""How much rows of a recording count, and how many of them are one independent observation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate

Array = NDArray[np.float64]
BATCHES = 4
"""Batches of rows per block, whose sums show slow noise [-]; assumed."""
SURE = 0.9
"""Part of the steady level above which friction counts as steady [-]; assumed."""
MOSTLY = 0.8
"""Part of rows at rest above which they have the same weight as the others [-]; assumed."""


def certain(data: Data, joint: int) -> Array:
    """Return (T,) weights: `uncertain` where a joint rests below its steady friction, else one."""
    s = data.settings.candidates
    speed = np.abs(rate(data.reversal_path[:, joint], data.runs(), data.dt))
    off = (speed < data.settings.motion.rest_speed) & (np.abs(data.direction(joint)) < SURE)
    # a joint that hardly ever moves has no other rows
    return np.where(off, s.uncertain, 1.0) if off.mean() < MOSTLY else np.ones(len(off))


def explained(left: Array, limit: float) -> Array:
    """Return (T,) Huber weights: below one where a row is far from what a model explains.

    Args:
        left: (T,) what the model leaves of a torque [N·m].
        limit: distance up to which rows count in full [standard deviations, by the median].
    """
    scale = 1.4826 * float(np.median(np.abs(left - np.median(left)))) + 1e-12
    return np.minimum(1.0, limit * scale / np.maximum(np.abs(left), 1e-300))


def filtered_rows(data: Data) -> float:
    """Return how many rows the filter makes one observation: those of half a period of it."""
    if not (np.isfinite(data.dt) and np.isfinite(data.cutoff)):
        return 1.0
    return max(1.0, 0.5 / (data.cutoff * data.dt))


def dependent_rows(data: Data, joint: int, left: Array, weight: Array) -> float:
    """Return the number of rows that form one independent observation of the noise floor.

    What a model leaves is more than that noise, and slower. Sums over batches of rows show how
    slow: for independent rows the square of one is the number of its rows (A. Law, W. Kelton,
    "Simulation Modeling and Analysis", 1991, 9.5.3).

    Args:
        data: the recording.
        joint: from 0.
        left: (T,) what a model leaves of its torque [N·m].
        weight: (T,) of its rows.
    """
    kept = left * np.sqrt(weight) / data.noise[joint]
    kept = kept[data.block >= 0]
    batches = np.array_split(kept, BATCHES * data.blocks)
    slow = float(np.mean([x.sum() ** 2 / max(len(x), 1) for x in batches]))
    return max(slow, filtered_rows(data) * max(float(np.mean(kept**2)), 1.0))
