"""Whether torques of a log are counted as the model has them; if not, they are turned.

    correct_sign(logs, signals, arm) -> logs, signals

A log whose ``tau`` is counted the other way round looks like an arm that gravity lifts. Where a
joint carries a load that changes, that cannot be mistaken: measured and rigid-body torque, both
without what an offset and friction explain (1, direction, speed), are then as good as opposite.
Where no joint does, friction that would drive the joint all the way there and back says the same.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.gap.settings import GapSettings, TorqueSignSettings, gap_settings
from stiction_envs.gap.signals.prepare import Segment, Signals
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Sign:
    """What one log says of the sign of one joint's torque."""

    log: int
    """From 0."""
    joint: int
    """From 1."""
    correlation: float
    """Of measured and rigid-body torque, without offset and friction [-]; without a load of
    measured torque and direction."""
    upright: float
    """Residual as logged, standard deviation [N·m]."""
    turned: float
    """Residual with the sign turned [N·m]."""
    loaded: bool
    """Whether the joint carries a load."""
    vote: int
    """-1: opposite, 1: as it should be, 0: not certain."""


def signs(signals: Signals, arm: Arm, settings: GapSettings | None = None) -> list[Sign]:
    """Return what joints with a load say, log by log."""
    own = settings or gap_settings()
    s, motion = own.torque_sign, own.measured.motion
    out = []
    for number, parts in by_log(signals).items():
        q, dq, ddq, tau = _rows(parts, s.most_rows)
        rigid = inverse_dynamics(arm.pinocchio(), q, dq, ddq)
        for j in range(arm.n):
            one, side = np.ones(len(q)), np.tanh(dq[:, j] / motion.reversal_speed)
            if rigid[:, j].std() > s.least_load:
                other = np.stack([one, side, dq[:, j]], axis=1)
                load, torque = without(rigid[:, j], other), without(tau[:, j], other)
                if load.std() > s.least_load:
                    out.append(_sign(number, j, load, torque, True, s))
                continue
            there, back = (side > s.clear_direction), (side < -s.clear_direction)
            if min(there.mean(), back.mean()) > motion.moving_share:
                other = np.stack([one, rigid[:, j], ddq[:, j]], axis=1)
                side, torque = without(side, other), without(tau[:, j], other)
                size = abs(float(side @ torque)) / float(side @ side)
                out.append(_sign(number, j, size * side, torque, False, s))
    return out


def _sign(
    log: int, joint: int, expected: Array, torque: Array, loaded: bool, s: TorqueSignSettings
) -> Sign:
    below = np.sqrt(float(expected @ expected) * float(torque @ torque))
    correlation = float(expected @ torque) / max(below, 1e-300)
    upright, turned = float((torque - expected).std()), float((torque + expected).std())
    opposite = correlation < -s.opposite and turned < s.residual_left * upright
    right = correlation > s.opposite and upright < s.residual_left * turned
    return Sign(
        log=log,
        joint=joint + 1,
        correlation=correlation,
        upright=upright,
        turned=turned,
        loaded=loaded,
        vote=-1 if opposite else int(right),
    )


def correct_sign(
    logs: Sequence[JointLog], signals: Signals, arm: Arm, settings: GapSettings | None = None
) -> tuple[list[JointLog], Signals]:
    """Turn the sign of all torques if they are counted the other way round.

    Args:
        logs: of one robot, with one convention.
        signals: made of them.
        arm: the nominal rigid arm.
        settings: constants of the method; None for those of ``settings.toml``.

    Returns:
        Logs, with a correction that says so, and signals; the same where the sign is right.

    Raises:
        StictionError: some joints or logs are opposite and others are not.
    """
    found = signs(signals, arm, settings)
    # friction can be pushed by somebody, a load cannot
    if any(s.loaded and s.vote for s in found):
        found = [s for s in found if s.loaded]
    wrong, right = ([s for s in found if s.vote == v] for v in (-1, 1))
    if not wrong:
        return list(logs), signals
    if right and not wrong[0].loaded:
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
    against = "rigid-body torque" if strongest.loaded else "direction (friction would push)"
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
    """Return logs and signals with all torques inverted, and the correction that says so."""
    turned = [
        dataclasses.replace(
            log,
            tau=-log.tau,
            extra={k: -v if k == "tau_cmd" else v for k, v in log.extra.items()},
            corrections=(
                *log.corrections,
                Correction(kind="sign", rows=len(log.t), text=text),
            ),
        )
        for log in logs
    ]
    segments = tuple(
        dataclasses.replace(
            s,
            tau=-s.tau,
            extra={k: -v if k == "tau_cmd" else v for k, v in s.extra.items()},
        )
        for s in signals.segments
    )
    return turned, dataclasses.replace(signals, segments=segments)


def by_log(signals: Signals) -> dict[int, list[Segment]]:
    """Return the segments of each log."""
    out: dict[int, list[Segment]] = {}
    for s in signals.segments:
        out.setdefault(s.log, []).append(s)
    return out


def _rows(parts: Sequence[Segment], most: int) -> tuple[Array, Array, Array, Array]:
    """Return angles, speeds, accelerations and torques of rows that are evenly picked."""
    step = max(1, -(-sum(len(s.t) for s in parts) // most))
    q, dq, ddq, tau = (
        np.concatenate([getattr(s, name)[::step] for s in parts])
        for name in ("q", "dq", "ddq", "tau")
    )
    return q, dq, ddq, tau


def without(y: Array, x: Array) -> Array:
    """Return y (T,) without what the columns x (T, k) explain."""
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])
