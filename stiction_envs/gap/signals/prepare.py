"""Joint logs as signals: evenly sampled, smooth, differentiated, through one zero-phase filter.

Angles and torques of a segment are interpolated to even times and pass the same low-pass forwards
and backwards, so that neither lags the other. Speeds and accelerations are central differences of
the filtered angles. Logged speeds are not used: robots filter them causally, and they lag
(measured: 5 ms on a Panda, 56 ms on an iiwa 14).

The cutoff comes from the spectra, each of which stops falling where noise takes over
(:mod:`stiction_envs.gap.signals.spectra`):

- Torque: above its own point it has no further information, except that dry friction jumps at each
  reversal and so reaches to high harmonics of the motion.
- Angle: above its point the acceleration is noise. This is harmless while the noise of the
  filtered acceleration, √(S (2π)⁴ f⁵/5) for white noise S of the angle, stays small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt_zi

from stiction_envs.compiled import compiled
from stiction_envs.errors import StictionError
from stiction_envs.gap.signals.angles import AngleError
from stiction_envs.gap.signals.reversal_path import WIDER, reversal_path
from stiction_envs.gap.signals.sessions import Sessions, sessions
from stiction_envs.gap.signals.spectra import ORDER, PERIODS, Spectra, by_column, resample
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion import MOVER_RATIO, REST_SPEED

Array = NDArray[np.float64]
# central differences of sixth order for the first and the second derivative, in samples
_FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
_SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
TRIM_PERIODS = 2.0
"""Periods of the cutoff that are cut off at each end, where the filter extrapolates [-].
Measured on sines: the acceleration's error is 0.3 % there."""
TRIM_SHARE = 0.15
"""Largest share of a segment that is cut off at each end [-]; assumed."""
RATE = 8.0
"""Number of rows kept per period of the cutoff [-]: measured on simulated logs, Coulomb and viscous
friction and presliding distances are those of all rows to 0.1 %."""
LEAST_RATE = 4.0
"""Least number of rows kept per period of the cutoff [-]; assumed."""
MOST_ROWS = 30_000
"""Most rows of all logs together [-]; assumed, to limit time and memory."""
PATH_RATE = 50.0
"""Number of rows of reversal paths per period of the cutoff [-]: measured likewise; with 20 of
them, friction is off by up to 6 % and presliding distances by 5 %. At 50, dry friction behind the
filter turns 0.2 ms late and is 0.2 % off."""
MOST_PATH_ROWS = 200_000
"""Most rows of reversal paths of all logs together [-]; assumed, to limit the time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A stretch without gaps, on even times; arrays are float64 and read-only."""

    log: int
    """Number of its log, from 0."""
    t: Array
    """Time on the log's clock, (K,), s; numbers of the poses for a static log."""
    q: Array
    """Angles, (K, n), rad."""
    dq: Array
    """Speeds, (K, n), rad/s."""
    ddq: Array
    """Accelerations, (K, n), rad/s²."""
    tau: Array
    """Torques, (K, n), N·m."""
    reversal_path: Array
    """Angles without overshoot or reversals caused by noise, (F, n), rad, at finer times than ``t``
    and from before its start to after its end: for friction's reversals
    (:mod:`stiction_envs.gap.signals.reversal_path`)."""
    first: int = 0
    """Row of the reversal path at the first time."""
    static: bool = False
    """At rest throughout: poses without time, or never faster than ``rest_speed``."""

    def __post_init__(self) -> None:
        for array in (self.t, self.q, self.dq, self.ddq, self.tau, self.reversal_path):
            array.flags.writeable = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """All segments of all logs."""

    segments: tuple[Segment, ...]
    dt: float
    """Time between samples of every segment except static poses, s; NaN without motion logs."""
    every: int = 1
    """Rows of the reversal path per sample."""
    cutoff_hz: float
    """Cutoff of the filter, Hz, where the amplitude is halved; NaN without any motion log."""
    noise_tau: Array
    """Noise of the filtered torques, standard deviation, (n,), N·m: the scale for residuals."""
    sessions: Sessions
    """When the logs were recorded."""
    notes: tuple[str, ...]
    """How the signals were computed, one sentence each."""
    torque_sign: int = 0
    """1 where the torques drive the joints, -1 where all were inverted; 0 where unknown."""
    torque_unit: Array = field(default_factory=lambda: np.ones(1))
    """(n,) what 1 N·m is in the unit of the logged torques, which were divided by it; (1,) alike
    for all."""
    measured: NDArray[np.bool_] | None = None
    """(n,) whether each torque is a measurement; None for all."""
    findings: tuple[str, ...] = ()
    """What is wrong with units, channels and mounting, one sentence each."""
    set_up: bool = False
    """Whether the arm is mounted otherwise, or a joint turns the other way: nothing else can be
    named then."""
    zero_off: AngleError | None = None
    """A joint whose zero is far from the model's."""


def lowpass(x: ArrayLike, rate_hz: float, cutoff_hz: float) -> Array:
    """Return the filter of all signals: Butterworth of order `ORDER`, forwards and backwards.

    Nonlinear functions of the signals must pass it too before a comparison.

    Args:
        x: even samples along the first axis.
        rate_hz: sampling rate, Hz.
        cutoff_hz: frequency at which half the amplitude is left, Hz; unchanged from half the
            sampling rate upwards.
    """
    x = np.asarray(x, np.float64)
    if 2 * cutoff_hz >= rate_hz or len(x) < 2:
        return x.copy()
    pad = min(len(x) - 1, int(np.ceil(3 * rate_hz / cutoff_hz)))
    columns = np.array(x.reshape(len(x), -1), order="C")
    return _both_ways(columns, *_sections(rate_hz, cutoff_hz), pad).reshape(x.shape)


@lru_cache
def _sections(rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Return the second-order sections of `lowpass`, and their states in steady motion."""
    sos = np.asarray(butter(ORDER, cutoff_hz, fs=rate_hz, output="sos"))
    return sos, np.asarray(sosfilt_zi(sos))


@compiled
def _both_ways(x: Array, sos: Array, steady: Array, pad: int) -> Array:
    """Return (K, k) filtered forwards, then backwards.

    Both ends are continued by ``pad`` samples of the signal turned about its end. scipy's
    `sosfiltfilt` does the same, but takes longer to begin than to filter a short segment.
    """
    rows, columns = x.shape
    y = np.empty((rows + 2 * pad, columns))
    y[pad : pad + rows] = x
    for i in range(pad):
        y[i] = 2 * x[0] - x[pad - i]
        y[rows + pad + i] = 2 * x[rows - 1] - x[rows - 2 - i]
    for _ in range(2):
        first = y[0].copy()
        for s in range(len(sos)):
            b0, b1, b2, _a0, a1, a2 = sos[s]
            u, v = steady[s, 0] * first, steady[s, 1] * first
            for i in range(len(y)):
                for c in range(columns):
                    x_in = y[i, c]
                    out = b0 * x_in + u[c]
                    u[c] = b1 * x_in - a1 * out + v[c]
                    v[c] = b2 * x_in - a2 * out
                    y[i, c] = out
        y = y[::-1].copy()
    return y[pad : pad + rows]


def prepare(
    logs: Sequence[JointLog], *, cutoff_hz: float | None = None, most_samples: int = MOST_ROWS
) -> Signals:
    """Compute evenly sampled, filtered and differentiated signals of ``logs``.

    Args:
        logs: one or more logs of the same robot.
        cutoff_hz: cutoff of the filter, Hz; chosen from the data if None.
        most_samples: samples kept of all logs together, at most.

    Raises:
        StictionError: no log, logs of different robots, a cutoff that is not positive, or no
            segment long enough for it.
    """
    if not logs:
        raise StictionError("no log given: expected one or more")
    for log in logs:
        if log.n != logs[0].n:
            raise StictionError(
                f"{log.source}: {log.n} joints, but {logs[0].source} has {logs[0].n}: "
                "expected logs of one robot"
            )
    if cutoff_hz is not None and not (np.isfinite(cutoff_hz) and cutoff_hz > 0):
        raise StictionError(f"cutoff {cutoff_hz} Hz: expected numbers above 0")
    if most_samples < 1:
        raise StictionError(f"{most_samples} samples: expected whole numbers from 1")
    n = logs[0].n
    moving = [(i, log) for i, log in enumerate(logs) if not log.static]
    segments = [_poses(i, log) for i, log in enumerate(logs) if log.static]
    if not moving:
        return Signals(
            segments=tuple(segments),
            dt=float("nan"),
            cutoff_hz=float("nan"),
            noise_tau=np.full(n, np.nan),
            sessions=sessions(logs),
            notes=("poses at rest only: nothing filtered",),
        )
    # without the last digits, which are rounding of the times
    steps = [float(f"{log.step:.6g}") for _, log in moving]
    notes: list[str] = []
    spectra = Spectra([log for _, log in moving], steps, MOVER_RATIO)
    cutoff = spectra.choose(notes) if cutoff_hz is None else float(cutoff_hz)
    seconds = sum(log.t[s][-1] - log.t[s][0] for _, log in moving for s in log.segments)
    fine = _multiple(max(steps), PATH_RATE * cutoff, MOST_PATH_ROWS / seconds)
    dt = _multiple(fine, RATE * cutoff, most_samples / seconds)
    every = round(dt / fine)
    most = 1 / (LEAST_RATE * dt)
    if cutoff_hz is None and cutoff > most:
        notes.append(
            f"the cutoff is lowered from {cutoff:.3g} Hz to {most:.3g} Hz: in {seconds:.4g} s "
            f"there are too many rows for more, thinned out to {1 / dt:.4g} Hz"
        )
        cutoff = most
    left_out, shortest = 0, (PERIODS - 1) / cutoff
    for (i, log), step in zip(moving, steps, strict=True):
        for rows in log.segments:
            made = _segment(i, log, rows, step, fine, every, cutoff, REST_SPEED)
            left_out += made is None
            segments += [made] if made is not None else []
    if left_out:
        plural = "s" if left_out > 1 else ""
        notes.append(
            f"{left_out} segment{plural} shorter than {shortest:.3g} s left out: "
            "too short for the filter"
        )
    if not any(s for s in segments if not logs[s.log].static):
        raise StictionError(
            f"{moving[0][1].source}: no segment of {shortest:.3g} s "
            f"without a gap: expected one or more (cutoff {cutoff:.3g} Hz)"
        )
    if spectra.rounded().all():
        notes.append(
            "the torques are smooth down to the last digit: they were filtered before they were "
            "logged, and their noise is larger than it seems"
        )
    segments.sort(key=lambda s: (s.log, s.t[0]))
    notes += _rest(segments, dt, REST_SPEED)
    return Signals(
        segments=tuple(segments),
        dt=dt,
        every=every,
        cutoff_hz=cutoff,
        noise_tau=spectra.noise(cutoff),
        sessions=sessions(logs),
        notes=tuple(notes),
    )


def _multiple(step: float, rate: float, most_rate: float) -> float:
    """Return the multiple of a step [s] that leaves a rate, but no more than another [Hz]."""
    return step * max(1, int(1 / (step * rate)), int(np.ceil(1 / (step * most_rate) - 1e-9)))


def _segment(
    number: int,
    log: JointLog,
    rows: slice,
    step: float,
    fine: float,
    every: int,
    cutoff: float,
    slow: float,
) -> Segment | None:
    """Return the signals of some rows of a log; None where they are too short for the filter."""
    seconds = log.t[rows][-1] - log.t[rows][0]
    # One period of margin for the rounding of the longest segment's own cutoff.
    if seconds < (PERIODS - 1) / cutoff or rows.stop - rows.start < 16:
        return None
    t, q, tau = resample(log, rows, step)
    path = by_column(lambda x: reversal_path(x, 1 / step, cutoff, lowpass), q)
    q, tau = lowpass(q, 1 / step, cutoff), lowpass(tau, 1 / step, cutoff)
    dq = by_column(lambda x: np.convolve(x, _FIRST[::-1], "same") / step, q)
    ddq = by_column(lambda x: np.convolve(x, _SECOND[::-1], "same") / step**2, q)
    # The filter does not know the signal before and after, nor does the wider one of the path.
    cut = max(3 * step, min(TRIM_PERIODS / cutoff, TRIM_SHARE * seconds))
    start, factor = int(np.ceil(cut / WIDER / step)), round(fine / step)
    first = int(np.ceil(cut / fine)) - start // factor
    if abs(factor * step - fine) < 1e-6 * fine:
        even = slice(start, len(t) - start, factor)
        t, path, q, dq, ddq, tau = (x[even] for x in (t, path, q, dq, ddq, tau))
    else:
        at = np.arange(t[start], t[-1 - start], fine)
        path = by_column(lambda x: np.interp(at, t, x), path)
        q, dq, ddq, tau = (CubicSpline(t, x)(at) for x in (q, dq, ddq, tau))
        t = at
    rows = slice(first, len(t) - first, every)
    t, q, dq, ddq, tau = (x[rows].copy() for x in (t, q, dq, ddq, tau))
    return Segment(
        log=number,
        t=t,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        reversal_path=path.copy(),
        first=first,
        static=bool(np.abs(dq).max() < slow),
    )


def _poses(number: int, log: JointLog) -> Segment:
    """Return poses as a segment at rest."""
    q, zero = log.q.copy(), np.zeros_like(log.q)
    return Segment(
        log=number,
        t=log.t.copy(),
        q=q,
        dq=zero,
        ddq=zero,
        tau=log.tau.copy(),
        reversal_path=q,
        static=True,
    )


def _rest(segments: Sequence[Segment], dt: float, slow: float) -> list[str]:
    """Return how long the arm rests, if it rests for long."""
    moved = [s for s in segments if not s.static]
    count = sum(len(s.t) for s in moved)
    resting = sum(int((np.abs(s.dq).max(axis=1) < slow).sum()) for s in moved)
    if not count or resting < 0.1 * count:
        return []
    return [f"the arm rests in {resting / count:.0%} of the {count * dt:.3g} s"]
