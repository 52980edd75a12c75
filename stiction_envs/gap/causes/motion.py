"""What a log's motion excites: predicates that causes share to say what they cannot see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate

Array = NDArray[np.float64]
MOVING = 0.02
"""A joint that is faster moves for certain [rad/s]; assumed, ten times the sign's width."""
SLOW = 0.01
"""Speed between which and its opposite a joint reverses for certain [rad/s]; assumed."""
STILL = 0.02
"""Span of angles in which a joint only holds [rad]; assumed."""
MUCH = 0.02
"""Least part of the samples in which a cause must act [-]; assumed."""


def moving(data: Data, joint: int) -> NDArray[np.bool_]:
    """Return (T,) where a joint moves for certain."""
    return np.asarray(np.abs(data.dq[:, joint]) > MOVING)


def rests(data: Data, joint: int) -> bool:
    """Whether a joint holds its angle throughout: friction then bears any torque up to its own."""
    span = float(np.ptp(np.percentile(data.q[:, joint], [1, 99])))
    return bool(moving(data, joint).mean() < MUCH) and span < STILL


def reversals(signal: Array, dead: float) -> int:
    """Return how often a signal (T,) goes from one side of ±``dead`` to the other."""
    side = np.sign(signal[np.abs(signal) > dead])
    return int(np.count_nonzero(np.diff(side)))


def lacks_both_directions(data: Data, joint: int) -> str:
    """Return why friction cannot be seen, or nothing."""
    v = data.dq[:, joint]
    if min((v > MOVING).mean(), (v < -MOVING).mean()) < MUCH:
        return f"joint {joint + 1} does not move in both directions"
    return ""


def changes(data: Data, torque: Array) -> NDArray[np.bool_]:
    """Return (n,) where a torque (T, n) changes by more than noise hides; a constant is an offset.

    Three times the noise floor, as for what a blind study calls visible (assumed).
    """
    return np.asarray(torque[data.block >= 0].std(axis=0) > 3 * data.noise)


def along_runs(data: Data, signal: Array) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    return rate(signal, data.runs(), data.dt)
