"""What a log's motion excites: predicates that causes share to say what they cannot see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate

Array = NDArray[np.float64]


def moving(data: Data, joint: int) -> NDArray[np.bool_]:
    """Return (T,) where a joint moves for certain."""
    return np.asarray(np.abs(data.dq[:, joint]) > data.settings.motion.moving_speed)


def rests(data: Data, joint: int) -> bool:
    """Whether a joint holds its angle throughout: friction then bears any torque up to its own."""
    s, span = data.settings.motion, float(np.ptp(np.percentile(data.q[:, joint], [1, 99])))
    return bool(moving(data, joint).mean() < s.acting_share) and span < s.hold_span


def reversals(signal: Array, dead: float) -> int:
    """Return how often a signal (T,) goes from one side of ±``dead`` to the other."""
    side = np.sign(signal[np.abs(signal) > dead])
    return int(np.count_nonzero(np.diff(side)))


def lacks_both_directions(data: Data, joint: int) -> str:
    """Return why friction cannot be seen, or nothing."""
    v, s = data.dq[:, joint], data.settings.motion
    if (span := float(np.ptp(data.q[:, joint]))) < s.hold_span:
        return f"joint {joint + 1} turns by {span:.3f} rad only"
    if min((v > s.moving_speed).mean(), (v < -s.moving_speed).mean()) < s.acting_share:
        return f"joint {joint + 1} does not move in both directions"
    return ""


def changes(data: Data, torque: Array) -> NDArray[np.bool_]:
    """Return (n,) where a torque (T, n) changes by more than noise hides; constants do not."""
    return np.asarray(torque[data.block >= 0].std(axis=0) > data.settings.noise.seen * data.noise)


def along_runs(data: Data, signal: Array) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    return rate(signal, data.runs(), data.dt)
