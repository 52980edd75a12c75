"""Stretches in which the arm touches something: a joint stands far from its command and stalls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
FAR_OFF = 8.0
"""Least error of the fitted model in contact, over its usual size [-]; assumed."""
STRETCHED, ELSEWHERE = 1.3, 99.0
"""Least distance from the command in contact over this percentile [%] elsewhere [-]; assumed."""
SUSPECT, USUAL = 3.0, 85.0
"""Distance from the command that is suspected over this percentile [%] of all [-]; assumed."""
STALLED, MOVING = 0.1, 75.0
"""Largest speed in contact over the mean of those above this percentile [%] [-]; assumed."""
AROUND = 0.5
"""Time left out before and after a contact [s]; assumed."""
MOST = 0.4
"""Largest share of the rows: more is no contact but another cause [-]; assumed."""


def suspected(motion: JointMotion) -> Rows:
    """Return (T,) rows in which a joint stands much further from its command than usually.

    They would bend a fit to all rows, and are judged by one to the others.
    """
    stretched = np.abs(motion.command - motion.q)
    return np.asarray(stretched > SUSPECT * np.percentile(stretched, USUAL))


def in_contact(motion: JointMotion, error: Array, resolution: float) -> Rows:
    """Return (T,) rows in which a joint seems to touch something or to stand at a stop.

    ``error`` (T,) is the measured angle less that of a model fitted without suspected rows [rad],
    ``resolution`` the step of the measured angle [rad].
    """
    usual = max(1.4826 * float(np.median(np.abs(error - np.median(error)))), resolution)
    stretched = np.abs(motion.command - motion.q)
    off = np.abs(error) > FAR_OFF * usual
    if not off.any() or off.mean() > MOST:
        return np.zeros(len(error), dtype=bool)
    speed = np.abs(np.gradient(motion.q, motion.t))
    moving = speed[speed > np.percentile(speed, MOVING)]
    slow = speed < STALLED * float(moving.mean()) if len(moving) else np.ones(len(speed), bool)
    elsewhere = np.percentile(stretched[~off], ELSEWHERE)
    found = off & slow & (stretched > STRETCHED * elsewhere)
    reach = motion.rows_in(AROUND)
    # stretches shorter than that are no contact but a moment of stick and slip
    long = np.convolve(found, np.ones(reach), "same") >= 0.5 * reach
    wide: Rows = np.convolve(found & long, np.ones(2 * reach + 1), "same") > 0
    return wide


def stretches(t: Array, rows: Rows) -> list[list[float]]:
    """Return first and last time of each run of rows [s]."""
    return [[float(t[a]), float(t[b - 1])] for a, b in _runs(rows)]


def _runs(rows: Rows) -> list[tuple[int, int]]:
    """Return first row of each run of rows, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def pushing(current: Array, rows: Rows) -> Rows:
    """Return which rows (T,) in contact the motor pushes in: its current is the witness.

    ``current`` (T,) is the size of the motor's current [any unit]; NaN where it was not logged.
    """
    if np.isnan(current).all() or not rows.any() or rows.all():
        return rows
    usual = float(np.nanmedian(current[~rows]))
    out = np.zeros_like(rows)
    for a, b in _runs(rows):
        out[a:b] = not np.nanmedian(current[a:b]) <= usual
    return out
