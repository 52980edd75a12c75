"""Checks of a servo log by itself: units of its commands, channels that never move or are copies.

Angles in steps of the encoder, and joints that rest while their command moves, are no defects.
"""

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import check_angles, check_torques
from stiction_envs.measured.logs.corrections import RawLog
from stiction_envs.measured.motion_thresholds import HOLD_SPAN, TRAVEL_SPAN
from stiction_envs.robots.arm_toml import Limits

OTHER_UNIT = 20.0
"""Commands that move by this many times what the joint moves are in another unit [-]; assumed."""
ALIKE = 0.9
"""Least correlation of a command and the angle that follows it, to compare units [-]; assumed."""

MOST_LAG = 0.2  # longest time between command and motion to try [s]; assumed


def check_servo_units(rows: RawLog, limits: Limits | None) -> list[str]:
    """Return warnings about commanded and measured angles beyond the ``limits``.

    Raises:
        StictionError: angles look like degrees, or are in different units.
    """
    warnings = [w for name in ("q", "q_cmd") for w in check_angles(rows, limits, name)]
    ratios = []
    for q, command in zip(rows.data["q"].T, rows.data["q_cmd"].T, strict=True):
        moves = q.std() > 0 and command.std() > 0
        if moves and np.corrcoef(q, command)[0, 1] > ALIKE:
            ratios.append(command.std() / q.std())
    ratio = float(np.median(ratios)) if ratios else 1.0
    if not 1 / OTHER_UNIT < ratio < OTHER_UNIT:
        raise StictionError(
            f"{rows.place(0)}: q_cmd moves by {ratio:.3g} times what q does, which looks like "
            "degrees beside radians: expected both in rad"
        )
    return warnings


def check_servo_channels(rows: RawLog) -> list[str]:
    """Return warnings about commands and angles that never change, and about copies.

    Raises:
        StictionError: neither command nor angle ever changes.
    """
    q, command = rows.data["q"], rows.data["q_cmd"]
    n, moved, told = q.shape[1], np.ptp(q, axis=0), np.ptp(command, axis=0)
    if not (moved.any() or told.any()):
        raise StictionError(
            f"{rows.place(0)}: q_cmd1..q_cmd{n} and q1..q{n} never change: expected a measurement"
        )
    warnings = []
    if not told.any():
        warnings.append(
            f"q_cmd1..q_cmd{n} never change although a joint moves: was the command logged?"
        )
    for j in np.flatnonzero((told > HOLD_SPAN) & (moved == 0)):
        warnings.append(
            f"q{j + 1} is always {q[0, j]:.4g} although its command moves by {told[j]:.3g} rad: "
            "was its position measured?"
        )
    copies = [f"q{j + 1}" for j in range(n) if told[j] and np.array_equal(q[:, j], command[:, j])]
    if copies:
        warnings.append(
            f"{', '.join(copies)} equal{'s' * (len(copies) == 1)} the command in every row: "
            "not measured, or a perfect servo"
        )
    warnings += _late_commands(rows)
    current = rows.data.get("current_abs")
    if current is not None and (current < 0).any():
        first = int(np.argmax((current < 0).any(axis=0)))
        warnings.append(f"current_abs{first + 1} is negative in places: its size is used")
    return warnings + (check_torques(rows) if "tau" in rows.data else [])


def _late_commands(rows: RawLog) -> list[str]:
    """Return a warning where all commands come after the motion that follows them."""
    step = float(np.median(np.diff(rows.t)))
    most = int(min(MOST_LAG / max(step, 1e-6), len(rows.t) // 4))
    leads = []
    for q, command in zip(rows.data["q"].T, rows.data["q_cmd"].T, strict=True):
        if min(np.ptp(q), np.ptp(command)) < TRAVEL_SPAN or most < 2:
            continue
        v, u = np.diff(q)[most:-most], np.diff(command)
        with np.errstate(invalid="ignore"):  # a constant stretch is like nothing
            likeness = [np.corrcoef(v, u[k : k + len(v)])[0, 1] for k in range(2 * most + 1)]
        best = int(np.argmax(likeness))
        leads.append((best - most) * step if likeness[best] > ALIKE else np.nan)
    if not leads or not np.nanmin([*leads, np.inf]) > 1.5 * step or np.isnan(leads).any():
        return []
    late = float(np.median(leads))
    return [
        f"q_cmd comes {1e3 * late:.0f} ms after the motion that it commands, on all joints: is the "
        "time of q_cmd wrong, or is it no command?"
    ]
