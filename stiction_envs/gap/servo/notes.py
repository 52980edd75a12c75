"""What to say of servo logs before they are diagnosed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

EARLY = 0.025
"""Time by which a command comes after the motion that is more than late stamps [s]; assumed: the
angles of a bus of six servos are 20 ms younger than their stamps."""
AHEAD = np.arange(0.0, 0.2, 0.002)
"""Such times that are tried [s]; assumed."""
EARLY_LEAVES = 0.25
"""Most that such a time leaves of a joint's squared distance from its command [-]; assumed."""


def notes_of(arm: Arm, logs: Sequence[ServoLog]) -> list[str]:
    """Return notes on the model's limits and springs, and on commands that come late."""
    return [*_limit_notes(arm, logs), *_late_notes(logs)]


def _limit_notes(arm: Arm, logs: Sequence[ServoLog]) -> list[str]:
    """Return what to say of angles beyond the model's limits, and of springs, which it lacks."""
    q = np.concatenate([log.q for log in logs])
    out = ["springs of the robot's file are left out"] if arm.stated.stiffness.any() else []
    turns = arm.limits.assumed("position")
    for j, (low, high) in enumerate(arm.limits.position):
        least, most = float(q[:, j].min()), float(q[:, j].max())
        if turns[j]:
            continue
        if least < low or most > high:
            out.append(
                f"joint {j + 1} was logged from {least:.4g} to {most:.4g} rad, its model ends at "
                f"{low:.4g} and {high:.4g}: the limits were widened, check its zero"
            )
    return out


def _late_notes(logs: Sequence[ServoLog]) -> list[str]:
    """Return what to say of logs whose commands come after the motion that should follow them."""
    out = []
    for log in logs:
        left = np.zeros((len(AHEAD), log.n))
        for s in log.segments:
            for j in range(log.n):
                t, command, q = log.t[s], log.q_cmd[s, j], log.q[s, j]
                left[:, j] += [np.sum(np.square(np.interp(t + x, t, command) - q)) for x in AHEAD]
        late = AHEAD[np.argmin(left, axis=0)]
        early = 1e3 * late[(late > EARLY) & (left.min(axis=0) < EARLY_LEAVES * left[0])]
        if len(early):
            out.append(
                f"{Path(log.source).name}: the command comes {early.min():.0f} to "
                f"{early.max():.0f} ms after the motion of {len(early)} joints: check the stamps"
            )
    return out
