"""Torque lag: a log's torques come after its angles, or were low-passed by the driver.

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

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from stiction_envs.arrays import Array, Index, rms
from stiction_envs.filters import lagging
from stiction_envs.gap.signals.angles import least_load
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, passive_torque
from stiction_envs.gap.signals.torque_sign import OF_CHANNELS, correct_sign
from stiction_envs.measured.logs.corrections import Correction
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion_thresholds import REVERSAL_SPEED
from stiction_envs.robots import Arm

Lag = tuple[float, float]
"""δ and T [s]."""
LEAST_LAG = 0.1
"""Least sum of delay and time constant that is corrected where a load shows it [s]; assumed: the
cause `actuator_delay` covers shorter ones."""
LEAST_FRICTION_LAG = 0.01
"""Least sum where only friction shows the lag, which that cause does not cover [s]; assumed."""
RESIDUAL_LEFT = 0.5
"""Largest remaining part of the residual for a lag to be corrected [-]; assumed."""
DELAYS = np.arange(0.0, 0.1501, 0.01)
"""Delays to try [s]; assumed."""
LOWPASSES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1)
"""Time constants to try [s]; assumed."""
HINT_LEFT = 0.85
"""Part of the residual that some delay leaves at most, for a further search [-]; assumed."""
LEAST_RUNS = 4
"""Least number of runs that distinguish a time from a distance [-]; assumed."""
SPEED_RATIO = 3.0
"""Least ratio of the fastest to the slowest run [-]; assumed."""
LAG_RATIO = 1.3
"""Largest ratio of these runs' lags for a time [-]; for a distance it would be `SPEED_RATIO` or
more. Assumed."""
MOST_ROWS = 4000
"""Most rows of a log that are fitted [-]; assumed, to limit the time."""


class _Run(NamedTuple):
    """One segment of one joint: F times are finer than T."""

    t: Array
    """(T,) times at which torque is fitted [s]."""
    torque: Array
    """(T,) [N·m]."""
    fixed: Array
    """(T, k) columns that are not shifted."""
    finer: Array
    """(F,) times of the columns that are shifted [s]."""
    moved: Array
    """(F, k) these columns."""


def torque_lag(signals: Signals, arm: Arm) -> tuple[Lag, str, bool] | None:
    """Return the lag of one log's torques; None where they do not lag.

    A sentence on the lag and the evidence follows, and whether friction cannot explain the lag.
    """
    parts, rigid, joints = _loads(signals, arm)
    loaded = len(joints) > 0
    if not loaded:
        if len(parts) < LEAST_RUNS:
            return None
        speed = rms(np.concatenate([signals.dq[x] for x in parts]))
        joints = np.array([np.argmax(speed)])
    runs = [_runs(signals, parts, rigid, int(j), loaded) for j in joints]
    found = _search(runs)
    if found is None:
        return None
    lag, before, after = found
    best = int(np.argmin(after / before))
    least = LEAST_LAG if loaded else LEAST_FRICTION_LAG
    if sum(lag) <= least or after[best] >= RESIDUAL_LEFT * before[best]:
        return None
    text = _lag_text(*lag)
    evidence = (
        f"residual of joint {joints[best] + 1} given scale, offset and friction falls from "
        f"{before[best]:.3g} to {after[best]:.3g} N·m"
    )
    if not loaded and not _is_time(runs[0]):
        return lag, f"{text}, or friction lags its reversals: {evidence} with the former", False
    why = "" if loaded else ", at all speeds"
    return lag, f"{text}{why}: undone ({evidence})", True


def has_lag(signals: Signals, arm: Arm, lag: Lag) -> bool:
    """Return whether the torques of one log may have a lag; only a load can show the contrary."""
    parts, rigid, joints = _loads(signals, arm)
    runs = [_runs(signals, parts, rigid, int(j), True) for j in joints]
    now, left = (np.array([_residual(x, y) for x in runs]) for y in ((0.0, 0.0), lag))
    if not np.all(np.isfinite([now, left])) or np.any(now <= 0):
        return True
    return float(np.square(left / now).sum()) <= len(runs)


def correct_torques(
    logs: Sequence[JointLog],
    arm: Arm,
    make: Callable[[Sequence[JointLog]], Signals],
    known_sign: int = 0,
    known_lag: Lag | None = None,
    known_unit: Array | None = None,
) -> tuple[list[JointLog], Signals]:
    """Return logs and signals after torques were corrected: their sign, unit and lag.

    Args:
        logs: of one robot.
        arm: the nominal rigid arm.
        make: makes signals of logs.
        known_sign: as in `correct_sign`.
        known_lag: by an earlier diagnosis of the robot; None for none.
        known_unit: as in `correct_sign`.

    Raises:
        StictionError: torques of some joints or logs have the opposite sign, others not.
    """
    read, signals = correct_sign(logs, make(logs), arm, known_sign, known_unit)
    changed = False
    for i, log in enumerate(read):
        if log.static:
            continue
        # several logs together may be thinned out so far that a delay is no longer visible
        own = signals if len(read) == 1 else make([log])
        if known_lag is not None:
            if has_lag(own, arm, known_lag):
                text = f"{_lag_text(*known_lag)}, as those of the nominal model's logs: undone"
                read[i] = _undone(log, known_lag, text)
                changed = True
                continue
            text = f"not so in this log: {_lag_text(*known_lag)} (the nominal model's logs)"
            log = dataclasses.replace(log, warnings=(*log.warnings, text))
            read[i] = log
        found = torque_lag(own, arm)
        if found is None:
            continue
        undone_lag, text, certain = found
        if certain:
            read[i] = _undone(log, undone_lag, text)
            changed = True
        else:
            read[i] = dataclasses.replace(log, warnings=(*log.warnings, text))
    if changed:
        shown = {x: getattr(signals, x) for x in OF_CHANNELS}
        signals = dataclasses.replace(make(read), **shown)
    return read, signals


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
    keep, segment = np.zeros(len(log.t), bool), np.zeros(len(log.t), np.int64)
    for number, rows in enumerate(log.segments):
        t, torque, segment[rows] = log.t[rows], log.tau[rows], number
        if len(t) < 8:
            continue
        sharp = torque + lowpass * np.gradient(torque, t, axis=0)
        tau[rows] = np.stack([np.interp(t + delay, t, x) for x in sharp.T], axis=1)
        keep[rows] = t + delay <= t[-1]
    return dataclasses.replace(
        log,
        t=log.t[keep],
        q=log.q[keep],
        dq=None if log.dq is None else log.dq[keep],
        tau=tau[keep],
        extra={k: v[keep] for k, v in log.extra.items()},
        breaks=tuple(int(i) for i in np.flatnonzero(np.diff(segment[keep])) + 1),
        corrections=(*log.corrections, done),
    )


def _loads(signals: Signals, arm: Arm) -> tuple[list[slice], Array, Index]:
    """Return segments with motion, the (T, n) rigid-body torque in these, and loaded joints.

    These joints (from 0) carry enough load to show a lag.
    """
    parts = [x for x in signals.runs if not signals.static[x.start] and x.stop - x.start > 32]
    rigid = np.full_like(signals.q, np.nan)
    if not parts:
        return [], rigid, np.zeros(0, np.int64)
    model = arm.pinocchio()
    for x in parts:
        q = signals.q[x]
        rigid[x] = inverse_dynamics(model, q, signals.dq[x], signals.ddq[x])
        rigid[x] += passive_torque(arm, q)
    load = np.concatenate([rigid[x] for x in parts]).std(axis=0)
    return parts, rigid, np.flatnonzero(load > least_load(model))


def _runs(
    signals: Signals, parts: Sequence[slice], rigid: Array, j: int, loaded: bool
) -> list[_Run]:
    """Return the columns of one joint; without a load, friction is the shifted column."""
    out, step = [], max(1, sum(x.stop - x.start for x in parts) // MOST_ROWS)
    for part in parts:
        t, v, ddq = signals.t[part], signals.dq[part, j], signals.ddq[part, j]
        finer = np.linspace(t[0], t[-1], (len(t) - 1) * signals.every + 1)
        rows = np.flatnonzero(t > t[0] + DELAYS[-1])[::step]

        def friction(v: Array) -> Array:
            return np.stack([np.tanh(v / REVERSAL_SPEED), v], axis=1)

        one = np.ones((len(rows), 1))
        if loaded:
            moved = CubicSpline(t, rigid[part, j][:, None])(finer)
            fixed = np.column_stack([friction(v[rows]), one])
        else:
            faster = CubicSpline(t, np.stack([v, ddq], axis=1))(finer)
            moved, fixed = np.column_stack([friction(faster[:, 0]), faster[:, 1]]), one
        out.append(_Run(t[rows], signals.tau[part, j][rows], fixed, finer, moved))
    return out


def _residual(runs: Sequence[_Run], lag: Lag) -> float:
    """Return the root mean square that a fit with a delay and a low-pass leaves [N·m]."""
    delay, lowpass = lag
    columns = []
    for run in runs:
        moved = run.moved
        if lowpass > 0:
            k = np.exp((run.finer[0] - run.finer[1]) / lowpass)
            moved = lagging(moved, k)
        shifted = [np.interp(run.t - delay, run.finer, x) for x in moved.T]
        columns.append(np.column_stack([*shifted, run.fixed]))
    x, y = np.concatenate(columns), np.concatenate([run.torque for run in runs])
    if len(y) <= x.shape[1]:
        return np.inf
    # normal equations: many fits of few columns
    c = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=None)[0]
    return float(np.sqrt(np.mean(np.square(y - x @ c))))


def _search(joints: Sequence[Sequence[_Run]]) -> tuple[Lag, Array, Array] | None:
    """Return the lag, and the joints' residuals without and with it; None without a hint."""

    def left(lag: Lag) -> Array:
        return np.array([_residual(j, lag) for j in joints])

    now = left((0.0, 0.0))
    if not np.all(np.isfinite(now)) or np.any(now <= 0):
        return None

    def size(lag: ArrayLike) -> float:
        delay, lowpass = (float(x) for x in np.asarray(lag))
        return float(np.square(left((delay, lowpass)) / now).sum())

    first = [left((d, 0.0)) / now for d in DELAYS[3::3]]
    if np.min(first) > HINT_LEFT:
        return None
    start = min(((float(d), t) for t in LOWPASSES for d in DELAYS), key=size)
    simplex = np.array([start, (start[0] + 0.005, start[1]), (start[0], start[1] + 0.005)])
    bounds = [(0.0, DELAYS[-1]), (0.0, 2 * LOWPASSES[-1])]
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-4}
    best = minimize(size, start, method="Nelder-Mead", bounds=bounds, options=options)
    lag = float(best.x[0]), float(best.x[1])
    return lag, now, left(lag)


def _is_time(runs: Sequence[_Run]) -> bool:
    """Return whether runs at several speeds lag by one time; bristles lag by one distance."""
    speeds, times = [], []
    for run in runs:
        v = np.abs(run.moved[:, 1])
        if np.sqrt(np.mean(v**2)) < REVERSAL_SPEED:
            continue
        left = [_residual([run], (d, 0.0)) for d in DELAYS]
        speeds.append(float(np.median(v)))
        times.append(float(DELAYS[int(np.argmin(left))]))
    if len(speeds) < LEAST_RUNS or max(speeds) < SPEED_RATIO * min(speeds):
        return False
    # one run may be disturbed
    usual = np.sort(times)[1:-1]
    return bool(usual[0] > LEAST_FRICTION_LAG and usual[-1] <= LAG_RATIO * usual[0])
