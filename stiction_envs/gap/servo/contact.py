"""Stretches in which the arm touches something: a joint stands far from its command and stalls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
FAR_OFF = 8.0
"""Least error of the fitted model in contact, over its usual size [-]; assumed."""
STRETCHED = 1.3
"""Least distance from the command in contact, over the 99th percentile elsewhere [-]; assumed."""
SUSPECT = 3.0
"""Distance from the command over its 85th percentile that is suspected [-]; assumed."""
STALLED = 0.1
"""Largest speed in contact, over the usual speed of the motion [-]; assumed."""
AROUND_SECONDS = 0.5
"""Left out before and after a contact [s]; assumed."""
MOST = 0.4
"""Largest share of the rows: more is no contact but another cause [-]; assumed."""


def suspected(motion: JointMotion) -> Rows:
    """Return (T,) rows in which a joint stands much further from its command than usually.

    They would bend a fit to all rows, and are judged by one to the others.
    """
    stretched = np.abs(motion.command - motion.q)
    out: Rows = stretched > SUSPECT * np.percentile(stretched, 85)
    return out


def in_contact(motion: JointMotion, error: Array, resolution: float) -> Rows:
    """Return (T,) rows in which a joint seems to touch something or to stand at a stop.

    Args:
        motion: of the joint.
        error: (T,) measured angle less that of a model fitted without suspected rows [rad].
        resolution: step of the measured angle [rad].
    """
    usual = max(1.4826 * float(np.median(np.abs(error - np.median(error)))), resolution)
    stretched = np.abs(motion.command - motion.q)
    off = np.abs(error) > FAR_OFF * usual
    if not off.any() or off.mean() > MOST:
        return np.zeros(len(error), dtype=bool)
    speed = np.abs(np.gradient(motion.q, motion.t))
    moving = speed[speed > np.percentile(speed, 75)]
    slow = speed < STALLED * float(moving.mean()) if len(moving) else np.ones(len(speed), bool)
    found = off & slow & (stretched > STRETCHED * np.percentile(stretched[~off], 99))
    step = float(np.median(np.diff(motion.t)))
    reach = max(1, round(AROUND_SECONDS / step))
    # stretches shorter than that are no contact but a moment of stick and slip
    long = np.convolve(found, np.ones(reach), "same") >= 0.5 * reach
    wide: Rows = np.convolve(found & long, np.ones(2 * reach + 1), "same") > 0
    return wide


def stretches(t: Array, rows: Rows) -> list[list[float]]:
    """Return first and last time of each run of rows [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    return [[float(t[a]), float(t[b - 1])] for a, b in zip(edges[::2], edges[1::2], strict=True)]
