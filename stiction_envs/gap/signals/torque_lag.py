"""Torques that were logged late: a channel behind the angles, and low-passed by its driver.

    mend_torques(logs, arm, prepare) -> logs, signals

An actuator acts after its command; nothing that acts comes before it is measured. Where measured
torque follows rigid-body torque n of the logged motion by some δ, and smoothed by a first-order
low-pass T, the log's channels are out of step:

    τ(t) = a·ñ(t − δ) + offset + friction(direction, speed),   T·dñ/dt + ñ = n

Only n is shifted, since friction may lag its reversals truly (bristles); where no joint carries a
load, friction is shifted, and only reversals at several speeds can say that it lags by a time and
not by a distance. Undone by τ(t + δ) + T·dτ/dt(t + δ).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from stiction_envs.gap.signals.prepare import Segment, Signals
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.gap.signals.torque_sign import LOAD, SLOW, by_log, mend_sign
from stiction_envs.measured.logs.corrections import Mend
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
DELAYS = np.arange(0.0, 0.1501, 0.01)
"""Delays that are tried [s]."""
LOWPASSES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1)
"""Time constants that are tried [s]."""
FINER_DELAYS, FINER_LOWPASSES = np.arange(-0.0075, 0.0076, 0.0025), (-0.01, -0.005, 0, 0.005, 0.01)
"""Steps about the best of them [s]."""
LATE = 0.1
"""Delay and time constant together from which on a load's torque is mended [s]: more than the cause
`actuator_delay` can hold, which names what is shorter."""
RESOLVED = 0.01
"""The same where only friction shows it, which that cause does not [s]; assumed."""
CLEAR = 0.5
"""What must be left of the residual; else nothing is done [-]; assumed."""
HINT = 0.85
"""What must be left of it at one of `FIRST` for a closer look [-]; assumed."""
FIRST = (0.03, 0.06, 0.1)
"""Delays of the first look [s]."""
RUNS, SPREAD = 4, 3.0
"""Runs, and fastest over slowest of them, that tell a time from a distance (assumed)."""
CONSTANT = 1.3
"""Largest over smallest lag of these runs for a time; a distance would have `SPREAD` or more;
assumed."""
FIRST_ROWS, MOST_ROWS = 4000, 20_000
"""Rows of a log at the first and at the closer look."""
SHAKE = 1e-2
"""Speed, root mean square, from which on a joint moves [rad/s]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Late:
    """One log whose torques come late."""

    log: int
    """From 0."""
    delay: float
    """δ [s]."""
    lowpass: float
    """T [s]."""
    joint: int
    """Whose residual falls most, from 1."""
    before: float
    """Its residual beside what is fitted, as logged [N·m]."""
    after: float
    """With δ and T [N·m]."""
    loaded: bool
    """Whether a load says so; else reversals at several speeds."""
    certain: bool
    """Whether it is beyond doubt."""


@dataclass(frozen=True, eq=False)
class _Run:
    """One segment of one joint; (T,) or (T, k)."""

    t: Array
    moved: Array
    """Columns that are shifted."""
    fixed: Array
    torque: Array


def late(signals: Signals, arm: Arm) -> list[Late]:
    """Return the logs whose torques come late, or may do so."""
    out = []
    for number, parts in by_log(signals).items():
        parts = [s for s in parts if not s.static and len(s.t) > 32]
        if not parts:
            continue
        rigid = _rigid(arm, parts)
        loaded = np.flatnonzero(np.concatenate(rigid).std(axis=0) > LOAD)
        speed = np.sqrt(np.mean(np.square(np.concatenate([s.dq for s in parts])), axis=0))
        found, certain = None, True
        if len(loaded):
            found = _search([_runs(parts, rigid, int(j), True) for j in loaded], signals.dt)
        elif len(parts) >= RUNS:
            loaded = np.array([int(np.argmax(speed))])
            runs = _runs(parts, rigid, int(loaded[0]), False)
            found = _search([runs], signals.dt)
            certain = found is not None and _is_time(runs, signals.dt)
        if found is None:
            continue
        delay, lowpass, before, after = found
        best = int(np.argmin(after / before))
        by_load = bool(np.concatenate(rigid)[:, loaded[best]].std() > LOAD)
        least = LATE if by_load else RESOLVED
        if delay + lowpass > least and after[best] < CLEAR * before[best]:
            out.append(
                Late(
                    log=number,
                    delay=delay,
                    lowpass=lowpass,
                    joint=int(loaded[best]) + 1,
                    before=float(before[best]),
                    after=float(after[best]),
                    loaded=by_load,
                    certain=certain,
                )
            )
    return out


def mend_torques(
    logs: Sequence[JointLog], arm: Arm, make: Callable[[Sequence[JointLog]], Signals]
) -> tuple[list[JointLog], Signals]:
    """Turn torques of the opposite sign, and undo delay and low-pass of those logged late.

    Args:
        logs: of one robot.
        arm: the nominal rigid arm.
        make: makes signals of logs.

    Returns:
        Logs and signals made of them; what changed has a mend that says so.

    Raises:
        StictionError: torques of some joints or logs have the opposite sign, others not.
    """
    read, signals = mend_sign(logs, make(logs), arm)
    changed = False
    for i, log in enumerate(read):
        if log.static:
            continue
        # several logs together may be thinned out so far that a delay is lost
        alone = signals if len(read) == 1 else make([log])
        found = next(iter(late(alone, arm)), None)
        if found is None:
            continue
        text = f"torques come {1e3 * found.delay:.0f} ms later than the angles they belong to"
        if found.lowpass:
            text += f", low-passed with a time constant of {1e3 * found.lowpass:.0f} ms"
        proof = (
            f"residual of joint {found.joint} beside scale, offset and friction falls from "
            f"{found.before:.3g} to {found.after:.3g} N·m"
        )
        if not found.certain:
            text = f"{text}, or friction lags its reversals: {proof} with the former"
            read[i] = dataclasses.replace(log, warnings=(*log.warnings, text))
            continue
        why = "" if found.loaded else ", at all speeds"
        mend = Mend(kind="late", rows=len(log.t), text=f"{text}{why}: undone ({proof})")
        made = _undone(log, found.delay, found.lowpass)
        read[i] = dataclasses.replace(made, mends=(*log.mends, mend))
        changed = True
    return read, make(read) if changed else signals


def _undone(log: JointLog, delay: float, lowpass: float) -> JointLog:
    """Return a log with torques brought forward; the end of each segment has none and goes."""
    tau = np.array(log.tau)
    keep = np.zeros(len(log.t), bool)
    for rows in log.segments:
        t, torque = log.t[rows], log.tau[rows]
        if len(t) < 8:
            continue
        sharp = torque + lowpass * np.gradient(torque, t, axis=0)
        tau[rows] = np.stack([np.interp(t + delay, t, x) for x in sharp.T], axis=1)
        keep[rows] = t + delay <= t[-1]
    number = np.zeros(len(log.t), np.int64)
    number[list(log.breaks)] = 1
    number = np.cumsum(number)[keep]
    return dataclasses.replace(
        log,
        t=log.t[keep],
        q=log.q[keep],
        dq=None if log.dq is None else log.dq[keep],
        tau=tau[keep],
        extra={k: v[keep] for k, v in log.extra.items()},
        breaks=tuple(int(i) for i in np.flatnonzero(np.diff(number)) + 1),
    )


def _rigid(arm: Arm, parts: Sequence[Segment]) -> list[Array]:
    """Return (T, n) rigid-body torque of each segment, between rows that are looked at."""
    model = arm.pinocchio()
    out = []
    step = max(1, sum(len(s.t) for s in parts) // MOST_ROWS)
    for s in parts:
        at = np.unique(np.r_[np.arange(0, len(s.t), step), len(s.t) - 1])
        torque = inverse_dynamics(model, s.q[at], s.dq[at], s.ddq[at])
        out.append(np.stack([np.interp(s.t, s.t[at], x) for x in torque.T], axis=1))
    return out


def _runs(parts: Sequence[Segment], rigid: Sequence[Array], j: int, loaded: bool) -> list[_Run]:
    """Return the columns of one joint; without a load its friction is what is shifted."""
    out = []
    for s, n in zip(parts, rigid, strict=True):
        v, one = s.dq[:, j], np.ones(len(s.t))
        friction = np.stack([np.tanh(v / SLOW), v], axis=1)
        if loaded:
            moved, fixed = n[:, j, None], np.column_stack([friction, one])
        else:
            moved, fixed = np.column_stack([friction, s.ddq[:, j]]), one[:, None]
        out.append(_Run(s.t, moved, fixed, s.tau[:, j]))
    return out


def _residual(runs: Sequence[_Run], delay: float, lowpass: float, dt: float, step: int) -> float:
    """Return the root mean square that a fit with a delay and a low-pass leaves [N·m]."""
    columns, torques = [], []
    for run in runs:
        moved = run.moved
        if lowpass > 0:
            k = np.exp(-dt / lowpass)
            moved = lfilter([1 - k], [1, -k], moved, axis=0, zi=k * moved[:1])[0]
        at = run.t[run.t > run.t[0] + DELAYS[-1]][::step]
        shifted = [np.interp(at - delay, run.t, x) for x in moved.T]
        rest = [np.interp(at, run.t, x) for x in (*run.fixed.T, run.torque)]
        columns.append(np.stack([*shifted, *rest[:-1]], axis=1))
        torques.append(rest[-1])
    x, y = np.concatenate(columns), np.concatenate(torques)
    if len(y) <= x.shape[1]:
        return np.inf
    # solved on the normal equations: many fits of few columns
    xx = x.T @ x
    c = np.linalg.lstsq(xx, x.T @ y, rcond=None)[0]
    return float(np.sqrt(np.mean(np.square(y - x @ c))))


def _search(
    joints: Sequence[Sequence[_Run]], dt: float
) -> tuple[float, float, Array, Array] | None:
    """Return δ, T and the residuals of the joints without and with them; None without a hint."""
    rows = sum(len(r.t) for r in joints[0])
    step = max(1, rows // FIRST_ROWS)
    now = np.array([_residual(j, 0.0, 0.0, dt, step) for j in joints])
    if not np.all(np.isfinite(now)) or np.any(now <= 0):
        return None
    first = [[_residual(j, d, 0.0, dt, step) for j in joints] for d in FIRST]
    if np.min(np.array(first) / now) > HINT:
        return None
    step = max(1, rows // MOST_ROWS)
    now = np.array([_residual(j, 0.0, 0.0, dt, step) for j in joints])
    tried = [(float(d), t) for t in LOWPASSES for d in DELAYS]
    best = (0.0, 0.0)
    for _ in range(2):
        left = np.array([[_residual(j, d, t, dt, step) for j in joints] for d, t in tried])
        k = int(np.argmin(np.sum(np.square(left / now), axis=1)))
        best = tried[k]
        tried = [
            (float(np.clip(best[0] + d, 0.0, DELAYS[-1])), float(max(best[1] + t, 0.0)))
            for t in FINER_LOWPASSES
            for d in FINER_DELAYS
        ]
    return *best, now, left[k]


def _is_time(runs: Sequence[_Run], dt: float) -> bool:
    """Whether runs at several speeds lag by the same time; bristles lag by the same distance."""
    speeds, times = [], []
    for run in runs:
        v = np.abs(run.moved[:, 1])
        if np.sqrt(np.mean(v**2)) < SHAKE:
            continue
        left = [_residual([run], d, 0.0, dt, 1) for d in DELAYS]
        speeds.append(float(np.median(v)))
        times.append(float(DELAYS[int(np.argmin(left))]))
    if len(speeds) < RUNS or max(speeds) < SPREAD * min(speeds):
        return False
    # one run may be disturbed
    usual = np.sort(times)[1:-1]
    return bool(usual[0] > RESOLVED and usual[-1] <= CONSTANT * usual[0])
