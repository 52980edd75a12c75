"""What a log's motion excites: tests that causes share, and why a motion cannot show a cause."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate

Array = NDArray[np.float64]


def moving(data: Data, joint: int) -> NDArray[np.bool_]:
    """Return (T,) where a joint certainly moves."""
    return np.asarray(np.abs(data.dq[:, joint]) > data.settings.motion.moving_speed)


def rests(data: Data, joint: int) -> bool:
    """Whether a joint holds its angle throughout: friction may then bear any smaller torque."""
    s, span = data.settings.motion, float(np.ptp(np.percentile(data.q[:, joint], [1, 99])))
    return bool(moving(data, joint).mean() < s.acting_share) and span < s.hold_span


def reversals(signal: Array, dead: float) -> int:
    """Return how often a signal (T,) goes from one side of ±``dead`` to the other."""
    side = np.sign(signal[np.abs(signal) > dead])
    return int(np.count_nonzero(np.diff(side)))


def turns_too_little(data: Data, joint: int, least: float) -> str:
    """Return that a joint turns by less than an angle [rad], or nothing."""
    span = float(np.ptp(data.q[:, joint]))
    return f"joint {joint + 1} turns by {span:.3f} rad only" if span < least else ""


def holds_one_pose(data: Data) -> str:
    """Return that no joint turns, or nothing."""
    most, least = float(np.ptp(data.q, axis=0).max()), data.settings.motion.travel_span
    return "the arm holds one pose only" if most < least else ""


def constant(data: Data, joint: int, torque: Array, what: str = "torque") -> str:
    """Return that a joint's torque (T,) does not change clearly, or nothing."""
    least = data.settings.noise.clear * data.noise[joint]
    return f"joint {joint + 1} carries no {what} that changes" if torque.std() < least else ""


def lacks_both_directions(data: Data, joint: int) -> str:
    """Return why friction cannot be seen, or nothing."""
    v, s = data.dq[:, joint], data.settings.motion
    if missing := turns_too_little(data, joint, s.hold_span):
        return missing
    if min((v > s.moving_speed).mean(), (v < -s.moving_speed).mean()) < s.acting_share:
        return f"joint {joint + 1} does not move in both directions"
    return ""


def changes(data: Data, torque: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return (n,) where a torque (T, n) changes by more than noise hides; constants do not."""
    return np.asarray(torque[data.block >= 0].std(axis=0) > data.settings.noise.seen * data.noise)


def along_runs(data: Data, signal: Array) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    return rate(signal, data.runs(), data.dt)
