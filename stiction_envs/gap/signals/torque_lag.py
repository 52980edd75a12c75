"""Torque lag: a log's torques come after its angles, or were low-passed by the driver.

    correct_torques(logs, arm, prepare) -> logs, signals

An actuator acts after its command, and a measurement never comes before the action. Where measured
torque follows the rigid-body torque n of the logged motion by a delay δ, smoothed by a first-order
low-pass T, the log's channels are not synchronous:

    τ(t) = a·ñ(t − δ) + offset + friction(direction, speed),   T·dñ/dt + ñ = n

Only n is shifted, since friction may really lag its reversals (bristles). Where no joint carries a
load, friction is shifted instead, and only reversals at several speeds can show that it lags by a
time and not by a distance. The correction is τ(t + δ) + T·dτ/dt(t + δ).

A lag that an earlier diagnosis of the robot found is undone without a search, unless a load shows
that these torques do not have it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.gap.signals.prepare import Segment, Signals
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.gap.signals.torque_sign import LEAST_LOAD, correct_sign
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Lag = tuple[float, float]
"""δ and T [s]."""
LEAST_LAG = 0.1
"""Least sum of delay and time constant that is corrected where a load shows it [s]; assumed: the
cause `actuator_delay` covers shorter ones."""
LEAST_FRICTION_LAG = 0.01
"""The same where only friction shows the lag, which that cause does not cover [s]; assumed."""
RESIDUAL_LEFT = 0.5
"""Largest remaining part of the residual for a lag to be corrected [-]; assumed."""
DELAYS = np.arange(0.0, 0.1501, 0.01)
"""Delays that are tried [s]; assumed."""
LOWPASSES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1)
"""Time constants that are tried [s]; assumed."""
FINER_DELAYS = np.arange(-0.0075, 0.0076, 0.0025)
"""Steps of the delay about the best one [s]; assumed."""
FINER_LOWPASSES = (-0.01, -0.005, 0.0, 0.005, 0.01)
"""Steps of the time constant about the best one [s]; assumed."""
FIRST_DELAYS = (0.03, 0.06, 0.1)
"""Delays of the first search [s]; assumed."""
HINT_LEFT = 0.85
"""Largest remaining part of the residual at a first delay for a closer search [-]; assumed."""
LEAST_RUNS = 4
"""Least number of runs that distinguish a time from a distance [-]; assumed."""
SPEED_RATIO = 3.0
"""Least ratio of the fastest to the slowest run [-]; assumed."""
LAG_RATIO = 1.3
"""Largest ratio of these runs' lags for a time [-]; for a distance it would be `SPEED_RATIO` or
more. Assumed."""
FIRST_ROWS = 4000
"""Most rows of a log in the first search [-]; assumed, to limit the time."""
MOST_ROWS = 20000
"""Most rows of a log in the closer search [-]; assumed, to limit the time."""


@dataclass(frozen=True, kw_only=True)
class TorqueLag:
    """By how much a log's torques lag its angles."""

    delay: float
    """δ [s]."""
    lowpass: float
    """T [s]."""
    joint: int
    """Joint whose residual falls most, from 1."""
    before: float
    """Residual of the joint after the fit, as logged [N·m]."""
    after: float
    """The same with δ and T [N·m]."""
    loaded: bool
    """Whether a load shows it; else reversals at several speeds show it."""
    certain: bool


@dataclass(frozen=True, eq=False)
class _Run:
    """One segment of one joint; (T,) or (T, k)."""

    t: Array
    moved: Array
    """Columns that are shifted in time."""
    fixed: Array
    torque: Array


def torque_lag(signals: Signals, arm: Arm, settings: GapSettings | None = None) -> TorqueLag | None:
    """Return how much the torques of one log lag, or may lag; None where they do not."""
    slow = (settings or gap_settings()).motion.reversal_speed
    parts = _moving(signals)
    if not parts:
        return None
    rigid, joints = _loads(arm, parts)
    loaded = len(joints) > 0
    if not loaded:
        if len(parts) < LEAST_RUNS:
            return None
        speed = np.sqrt(np.mean(np.square(np.concatenate([x.dq for x in parts])), axis=0))
        joints = np.array([np.argmax(speed)])
    runs = [_runs(parts, rigid, int(j), loaded, slow) for j in joints]
    found = _search(runs, signals.dt)
    if found is None:
        return None
    delay, lowpass, before, after = found
    best = int(np.argmin(after / before))
    least = LEAST_LAG if loaded else LEAST_FRICTION_LAG
    if delay + lowpass <= least or after[best] >= RESIDUAL_LEFT * before[best]:
        return None
    return TorqueLag(
        delay=delay,
        lowpass=lowpass,
        joint=int(joints[best]) + 1,
        before=float(before[best]),
        after=float(after[best]),
        loaded=loaded,
        certain=loaded or _is_time(runs[0], signals.dt, slow),
    )


def has_lag(signals: Signals, arm: Arm, lag: Lag, settings: GapSettings | None = None) -> bool:
    """Return whether the torques of one log may have a lag; only a load can show the contrary."""
    slow = (settings or gap_settings()).motion.reversal_speed
    parts = _moving(signals)
    if not parts:
        return True
    rigid, joints = _loads(arm, parts)
    runs = [_runs(parts, rigid, int(j), True, slow) for j in joints]
    step = max(1, sum(len(s.t) for s in parts) // FIRST_ROWS)
    now, left = (np.array([_residual(x, signals.dt, step, *y) for x in runs]) for y in ((), lag))
    if not np.all(np.isfinite([now, left])) or np.any(now <= 0):
        return True
    return float(np.square(left / now).sum()) <= len(runs)


def correct_torques(
    logs: Sequence[JointLog],
    arm: Arm,
    make: Callable[[Sequence[JointLog]], Signals],
    settings: GapSettings | None = None,
    known_sign: int = 0,
    known_lag: Lag | None = None,
) -> tuple[list[JointLog], Signals]:
    """Invert torques of the opposite sign, and correct the torques that lag.

    Args:
        logs: of one robot.
        arm: the nominal rigid arm.
        make: makes signals of logs.
        settings: constants of the method; None for those of ``settings.toml``.
        known_sign: as in `correct_sign`.
        known_lag: by an earlier diagnosis of the robot; None for none.

    Returns:
        Logs and their signals; each change is recorded as a correction.

    Raises:
        StictionError: torques of some joints or logs have the opposite sign, others not.
    """
    read, signals = correct_sign(logs, make(logs), arm, settings, known_sign)
    changed = False
    for i, log in enumerate(read):
        if log.static:
            continue
        # several logs together may be thinned out so far that a delay is no longer visible
        own = signals if len(read) == 1 else make([log])
        if known_lag is not None:
            if has_lag(own, arm, known_lag, settings):
                text = f"{_lag_text(*known_lag)}, as those of the nominal model's logs: undone"
                read[i] = _undone(log, known_lag, text)
                changed = True
                continue
            text = f"not so in this log: {_lag_text(*known_lag)} (the nominal model's logs)"
            log = dataclasses.replace(log, warnings=(*log.warnings, text))
            read[i] = log
        found = torque_lag(own, arm, settings)
        if found is None:
            continue
        text = _lag_text(found.delay, found.lowpass)
        evidence = (
            f"residual of joint {found.joint} given scale, offset and friction falls from "
            f"{found.before:.3g} to {found.after:.3g} N·m"
        )
        if not found.certain:
            text = f"{text}, or friction lags its reversals: {evidence} with the former"
            read[i] = dataclasses.replace(log, warnings=(*log.warnings, text))
            continue
        why = "" if found.loaded else ", at all speeds"
        text = f"{text}{why}: undone ({evidence})"
        read[i] = _undone(log, (found.delay, found.lowpass), text)
        changed = True
    return read, make(read) if changed else signals


def lag_of(logs: Sequence[JointLog], known: Lag | None = None) -> Lag | None:
    """Return the lag that was undone in most of some logs; ``known`` where none has a motion."""
    moving = [x for x in logs if not x.static]
    if not moving:
        return known
    lags = [next((c.lag for c in x.corrections if c.lag), (0.0, 0.0)) for x in moving]
    usual = sorted(lags, key=sum)[len(lags) // 2]
    return usual if sum(usual) > 0 else None


def _lag_text(delay: float, lowpass: float) -> str:
    text = f"torques come {1e3 * delay:.0f} ms later than the angles they belong to"
    return f"{text}, low-passed with a time constant of {1e3 * lowpass:.0f} ms" if lowpass else text


def _undone(log: JointLog, lag: Lag, text: str) -> JointLog:
    """Return a log with torques moved forward in time; each segment loses its end."""
    (delay, lowpass), tau = lag, np.array(log.tau)
    done = Correction(kind="lag", rows=len(log.t), text=text, lag=lag)
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
        corrections=(*log.corrections, done),
    )


def _moving(signals: Signals) -> list[Segment]:
    return [x for x in signals.segments if not x.static and len(x.t) > 32]


def _loads(arm: Arm, parts: Sequence[Segment]) -> tuple[list[Array], NDArray[np.int64]]:
    """Return `_rigid`, and the joints (from 0) that it loads enough to show a lag."""
    rigid = _rigid(arm, parts)
    return rigid, np.flatnonzero(np.concatenate(rigid).std(axis=0) > LEAST_LOAD)


def _rigid(arm: Arm, parts: Sequence[Segment]) -> list[Array]:
    """Return (T, n) rigid-body torque of each segment, interpolated between selected rows."""
    model = arm.pinocchio()
    out = []
    step = max(1, sum(len(s.t) for s in parts) // MOST_ROWS)
    for s in parts:
        at = np.unique(np.r_[np.arange(0, len(s.t), step), len(s.t) - 1])
        torque = inverse_dynamics(model, s.q[at], s.dq[at], s.ddq[at])
        out.append(np.stack([np.interp(s.t, s.t[at], x) for x in torque.T], axis=1))
    return out


def _runs(
    parts: Sequence[Segment], rigid: Sequence[Array], j: int, loaded: bool, slow: float
) -> list[_Run]:
    """Return the columns of one joint; without a load, friction is the shifted column."""
    out = []
    for s, n in zip(parts, rigid, strict=True):
        v, one = s.dq[:, j], np.ones(len(s.t))
        friction = np.stack([np.tanh(v / slow), v], axis=1)
        if loaded:
            moved, fixed = n[:, j, None], np.column_stack([friction, one])
        else:
            moved, fixed = np.column_stack([friction, s.ddq[:, j]]), one[:, None]
        out.append(_Run(s.t, moved, fixed, s.tau[:, j]))
    return out


def _residual(
    runs: Sequence[_Run], dt: float, step: int, delay: float = 0.0, lowpass: float = 0.0
) -> float:
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
    # normal equations: many fits of few columns
    xx = x.T @ x
    c = np.linalg.lstsq(xx, x.T @ y, rcond=None)[0]
    return float(np.sqrt(np.mean(np.square(y - x @ c))))


def _search(
    joints: Sequence[Sequence[_Run]], dt: float
) -> tuple[float, float, Array, Array] | None:
    """Return δ, T and the joints' residuals without and with them; None without a hint."""
    rows = sum(len(r.t) for r in joints[0])
    step = max(1, rows // FIRST_ROWS)
    now = np.array([_residual(j, dt, step) for j in joints])
    if not np.all(np.isfinite(now)) or np.any(now <= 0):
        return None
    first = [[_residual(j, dt, step, d) for j in joints] for d in FIRST_DELAYS]
    if np.min(np.array(first) / now) > HINT_LEFT:
        return None
    step = max(1, rows // MOST_ROWS)
    now = np.array([_residual(j, dt, step) for j in joints])
    tried = [(float(d), t) for t in LOWPASSES for d in DELAYS]
    best = (0.0, 0.0)
    for _ in range(2):
        left = np.array([[_residual(j, dt, step, d, t) for j in joints] for d, t in tried])
        k = int(np.argmin(np.sum(np.square(left / now), axis=1)))
        best = tried[k]
        tried = [
            (float(np.clip(best[0] + d, 0.0, DELAYS[-1])), max(best[1] + t, 0.0))
            for t in FINER_LOWPASSES
            for d in FINER_DELAYS
        ]
    return *best, now, left[k]


def _is_time(runs: Sequence[_Run], dt: float, slow: float) -> bool:
    """Whether runs at several speeds lag by the same time; bristles lag by the same distance."""
    speeds, times = [], []
    for run in runs:
        v = np.abs(run.moved[:, 1])
        if np.sqrt(np.mean(v**2)) < slow:
            continue
        left = [_residual([run], dt, 1, d) for d in DELAYS]
        speeds.append(float(np.median(v)))
        times.append(float(DELAYS[int(np.argmin(left))]))
    if len(speeds) < LEAST_RUNS or max(speeds) < SPEED_RATIO * min(speeds):
        return False
    # one run may be disturbed
    usual = np.sort(times)[1:-1]
    return bool(usual[0] > LEAST_FRICTION_LAG and usual[-1] <= LAG_RATIO * usual[0])
