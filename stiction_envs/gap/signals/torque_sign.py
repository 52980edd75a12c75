"""Whether torques of a log have the model's sign convention; if not, they are inverted.

    correct_sign(logs, signals, arm) -> logs, signals

Three things show the sign, the most reliable first:

1. A load that changes: measured and rigid-body torque, after offset and friction (1, direction,
   speed) are removed, are nearly opposite.
2. A load that joints hold: their mean torques are close to the model's, or to its opposite.
3. Friction: with the opposite sign it would drive the joint in both directions.

The sign from an earlier diagnosis of the same robot ranks after the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.gap.signals.prepare import Segment, Signals
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, passive_torque
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
CHANGING, HELD, FRICTION = "a changing load", "a held load", "friction"
"""What shows a sign, the most reliable first: somebody may push friction, but not a load."""
LEAST_LOAD = 0.5
"""Least standard deviation of a rigid-body torque that shows the sign [N·m]; assumed."""
LEAST_HELD = 5.0
"""Least load of all holding joints together for a sign [N·m]; assumed: friction holds less."""
LEAST_CORRELATION = 0.9
"""Least correlation of measured and expected torque for a sign to be certain [-]; assumed."""
RESIDUAL_LEFT = 0.5
"""Largest remaining part of the residual after inversion [-]; assumed."""
CLEAR_DIRECTION = 0.5
"""Smoothed direction, in [-1, 1], above which a joint counts as moving that way [-]; assumed."""
MOST_ROWS = 4000
"""Rows of a log that are used, evenly spaced [-]; assumed, to limit the time."""


@dataclass(frozen=True, kw_only=True)
class Sign:
    """What one log shows about the sign of one joint's torque."""

    log: int
    """Number of the log, from 0."""
    joint: int
    """Joint from 1; for loads that several joints hold, the one with the largest load."""
    shown_by: str
    """`CHANGING`, `HELD` or `FRICTION`."""
    correlation: float
    """Correlation of measured and expected torque [-]."""
    upright: float
    """Residual as logged [N·m]."""
    turned: float
    """Residual with the sign inverted [N·m]."""
    vote: int
    """-1: opposite, 1: correct, 0: not certain."""


def signs(signals: Signals, arm: Arm, settings: GapSettings | None = None) -> list[Sign]:
    """Return what loads and friction show, log by log."""
    motion = (settings or gap_settings()).motion
    out = []
    for number in dict.fromkeys(s.log for s in signals.segments):
        q, dq, ddq, tau = _rows([s for s in signals.segments if s.log == number])
        rigid = inverse_dynamics(arm.pinocchio(), q, dq, ddq) + passive_torque(arm, q)
        held = []
        for j in range(arm.n):
            one, side = np.ones(len(q)), np.tanh(dq[:, j] / motion.reversal_speed)
            if rigid[:, j].std() > LEAST_LOAD:
                other = np.stack([one, side, dq[:, j]], axis=1)
                load, torque = _without(rigid[:, j], other), _without(tau[:, j], other)
                if load.std() > LEAST_LOAD:
                    out.append(_sign(number, j, CHANGING, load, torque))
                continue
            held.append(j)
            there, back = (side > CLEAR_DIRECTION), (side < -CLEAR_DIRECTION)
            if min(there.mean(), back.mean()) > motion.moving_share:
                other = np.stack([one, rigid[:, j], ddq[:, j]], axis=1)
                side, torque = _without(side, other), _without(tau[:, j], other)
                size = abs(float(side @ torque)) / float(side @ side)
                out.append(_sign(number, j, FRICTION, size * side, torque))
        load, torque = rigid[:, held].mean(axis=0), tau[:, held].mean(axis=0)
        if np.linalg.norm(load) > LEAST_HELD:
            largest = held[int(np.argmax(np.abs(load)))]
            out.append(_sign(number, largest, HELD, load, torque))
    return out


def _sign(log: int, joint: int, shown_by: str, expected: Array, torque: Array) -> Sign:
    below = np.sqrt(float(expected @ expected) * float(torque @ torque))
    correlation = float(expected @ torque) / max(below, 1e-300)
    upright, turned = (float(np.sqrt(np.mean((torque - x) ** 2))) for x in (expected, -expected))
    opposite = correlation < -LEAST_CORRELATION and turned < RESIDUAL_LEFT * upright
    right = correlation > LEAST_CORRELATION and upright < RESIDUAL_LEFT * turned
    return Sign(
        log=log,
        joint=joint + 1,
        shown_by=shown_by,
        correlation=correlation,
        upright=upright,
        turned=turned,
        vote=-1 if opposite else int(right),
    )


def correct_sign(
    logs: Sequence[JointLog],
    signals: Signals,
    arm: Arm,
    settings: GapSettings | None = None,
    known: int = 0,
) -> tuple[list[JointLog], Signals]:
    """Invert all torques if they have the opposite sign.

    Args:
        logs: of one robot, with one convention.
        signals: made of them.
        arm: the nominal rigid arm.
        settings: constants of the method; None for those of ``settings.toml``.
        known: sign of the robot's torques by an earlier diagnosis, 1 or -1; 0 for none. Only a load
            that changes overrides it.

    Returns:
        Logs, with a note on the correction, and signals; unchanged where the sign is right.

    Raises:
        StictionError: some joints or logs are opposite and others are not.
    """
    sure = [s for s in signs(signals, arm, settings) if s.vote]
    kinds = [kind for kind in (CHANGING, HELD, FRICTION) if any(s.shown_by == kind for s in sure)]
    done = any(x.kind == "sign" for log in logs for x in log.corrections)
    if known and not done and CHANGING not in kinds:
        usual = "torques have the opposite sign of the usual one, as those of the diagnosed logs"
        text = f"{usual} of this robot: all inverted, so that tau drives the joint"
        return inverted(logs, signals, text) if known < 0 else (list(logs), signals)
    found = [s for s in sure if s.shown_by == kinds[0]] if kinds else []
    wrong, right = ([s for s in found if s.vote == v] for v in (-1, 1))
    if not wrong or (right and kinds[0] == FRICTION):
        return list(logs), signals
    if right:
        a, b = wrong[0], right[0]
        same = Path(logs[a.log].source).name if a.log == b.log else Path(logs[b.log].source).name
        raise StictionError(
            f"{logs[a.log].source}: tau{a.joint} has the opposite sign of what the model needs "
            f"(correlation {a.correlation:.2f}), but tau{b.joint} in {same} has the right one "
            f"({b.correlation:.2f}): expected one sign for all, tau drives the joint"
        )
    strongest = max(wrong, key=lambda s: s.upright)
    which = joint_list(sorted({s.joint for s in wrong}))
    against = "direction (friction would push)" if kinds[0] == FRICTION else "rigid-body torque"
    text = (
        "torques have the opposite sign of the usual one: all inverted, so that tau drives the "
        f"joint (correlation with {against} {min(s.correlation for s in wrong):.3f} to "
        f"{max(s.correlation for s in wrong):.3f} in {which}; inverted, the residual of joint "
        f"{strongest.joint} falls from {strongest.upright:.3g} to {strongest.turned:.3g} N·m)"
    )
    return inverted(logs, signals, text)


def inverted(
    logs: Sequence[JointLog], signals: Signals, text: str
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals with all torques inverted, and the correction's note."""
    turned = []
    for log in logs:
        extra = {k: -v if k == "tau_cmd" else v for k, v in log.extra.items()}
        done = (*log.corrections, Correction(kind="sign", rows=len(log.t), text=text))
        turned.append(replace(log, tau=-log.tau, extra=extra, corrections=done))
    segments = tuple(replace(s, tau=-s.tau) for s in signals.segments)
    return turned, replace(signals, segments=segments)


def _rows(parts: Sequence[Segment]) -> tuple[Array, Array, Array, Array]:
    """Return angles, speeds, accelerations and torques of evenly spaced rows."""
    step = max(1, -(-sum(len(s.t) for s in parts) // MOST_ROWS))
    q, dq, ddq, tau = (
        np.concatenate([getattr(s, name)[::step] for s in parts])
        for name in ("q", "dq", "ddq", "tau")
    )
    return q, dq, ddq, tau


def _without(y: Array, x: Array) -> Array:
    """Return y (T,) without the part that the columns x (T, k) explain."""
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])
