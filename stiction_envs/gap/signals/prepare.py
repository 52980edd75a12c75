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
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from stiction_envs.errors import StictionError
from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.gap.signals.reversal_path import reversal_path
from stiction_envs.gap.signals.sessions import Sessions, sessions
from stiction_envs.gap.signals.spectra import ORDER, PERIODS, Spectra, by_column, resample
from stiction_envs.measured.logs.reader import JointLog

Array = NDArray[np.float64]
# central differences of sixth order for the first and the second derivative, in samples
_FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
_SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
TRIM_PERIODS = 2.0
"""Periods of the cutoff that are cut off at each end, where the filter extrapolates [-].
Measured on sines: the acceleration's error is 0.3 % there."""
TRIM_SHARE = 0.15
"""Largest share of a segment that is cut off at each end [-]; assumed."""
MOST_RATE = 100.0
"""Largest number of samples kept per period of the cutoff [-]; assumed: times are right to a
hundredth of the filter's period. With a fiftieth, delays and bristles of a real log were lost."""
LEAST_RATE = 5.0
"""Least number of samples kept per period of the cutoff [-]; assumed."""


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
    """Angles without overshoot or reversals caused by noise, (K, n), rad: for friction's reversals
    (:mod:`stiction_envs.gap.signals.reversal_path`)."""
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
    cutoff_hz: float
    """Cutoff of the filter, Hz, where the amplitude is halved; NaN without any motion log."""
    noise_tau: Array
    """Noise of the filtered torques, standard deviation, (n,), N·m: the scale for residuals."""
    motion_hz: float
    """Frequency that bounds nearly all of the motion, Hz; NaN without any motion log."""
    low_passed: NDArray[np.bool_]
    """Whether torque spectra continue to fall above the filter's band, (n,), as after a low-pass
    before logging: then the band may contain more noise than ``noise_tau`` from above it."""
    sessions: Sessions
    """When the logs were recorded."""
    notes: tuple[str, ...]
    """How the signals were computed, one sentence each."""


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
    return np.asarray(sosfiltfilt(_sections(rate_hz, cutoff_hz), x, axis=0, padlen=pad))


@lru_cache
def _sections(rate_hz: float, cutoff_hz: float) -> Array:
    """Return the second-order sections of `lowpass`."""
    return np.asarray(butter(ORDER, cutoff_hz, fs=rate_hz, output="sos"))


def prepare(
    logs: Sequence[JointLog],
    *,
    cutoff_hz: float | None = None,
    most_samples: int | None = None,
    settings: GapSettings | None = None,
) -> Signals:
    """Compute evenly sampled, filtered and differentiated signals of ``logs``.

    Args:
        logs: one or more logs of the same robot.
        cutoff_hz: cutoff of the filter, Hz; chosen from the data if None.
        most_samples: samples kept of all logs together; longer logs are thinned out after the
            filter; None for those of the settings.
        settings: constants of the method; None for those of ``settings.toml``.

    Raises:
        StictionError: no log, logs of different robots, a cutoff that is not positive, or no
            segment long enough for it.
    """
    own = settings or gap_settings()
    most_samples = own.recording.most_rows if most_samples is None else most_samples
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
            motion_hz=float("nan"),
            low_passed=np.zeros(n, dtype=bool),
            sessions=sessions(logs),
            notes=("poses at rest only: nothing filtered",),
        )
    # without the last digits, which are rounding of the times
    steps = [float(f"{log.step:.6g}") for _, log in moving]
    notes: list[str] = []
    spectra = Spectra([log for _, log in moving], steps, own)
    cutoff = spectra.choose(notes) if cutoff_hz is None else float(cutoff_hz)
    seconds = sum(log.t[s][-1] - log.t[s][0] for _, log in moving for s in log.segments)
    slowest = max(steps)
    enough = int(1 / (slowest * MOST_RATE * cutoff))
    thin = max(1, enough, int(np.ceil(seconds / slowest / most_samples)))
    dt = thin * slowest
    if thin > 1:
        text = f"thinned out after the filter to every {thin}th sample, {1 / dt:.4g} Hz"
        most = 1 / (LEAST_RATE * dt)
        if cutoff_hz is None and cutoff > most:
            text += f"; the cutoff is lowered for it from {cutoff:.3g} Hz"
            cutoff = most
        notes.append(text)
    left_out, shortest = 0, (PERIODS - 1) / cutoff
    for (i, log), step in zip(moving, steps, strict=True):
        for rows in log.segments:
            made = _segment(i, log, rows, step, dt, cutoff, own.motion.rest_speed)
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
    notes += _rest(segments, dt, own.motion.rest_speed)
    return Signals(
        segments=tuple(segments),
        dt=dt,
        cutoff_hz=cutoff,
        noise_tau=spectra.noise(cutoff),
        sessions=sessions(logs),
        motion_hz=spectra.motion_hz,
        low_passed=spectra.low_passed(cutoff, own.noise.falling),
        notes=tuple(notes),
    )


def _segment(
    number: int, log: JointLog, rows: slice, step: float, dt: float, cutoff: float, slow: float
) -> Segment | None:
    """Return the signals of some rows of a log; None where they are too short for the filter."""
    seconds = log.t[rows][-1] - log.t[rows][0]
    # One period of margin for the rounding of the longest segment's own cutoff.
    if seconds < (PERIODS - 1) / cutoff or rows.stop - rows.start < 16:
        return None
    t, q, tau = resample(log, rows, step)
    smooth = lowpass(q, 1 / step, cutoff)
    path = by_column(lambda x: reversal_path(x, 1 / step, cutoff, lowpass), q)
    core = {
        "q": smooth,
        "dq": by_column(lambda x: np.convolve(x, _FIRST[::-1], "same") / step, smooth),
        "ddq": by_column(lambda x: np.convolve(x, _SECOND[::-1], "same") / step**2, smooth),
        "tau": lowpass(tau, 1 / step, cutoff),
        "reversal_path": path,
    }
    # The filter does not know the signal before and after.
    ends = min(TRIM_PERIODS / cutoff, TRIM_SHARE * seconds)
    cut = max(3, int(np.ceil(ends / step)))
    factor = round(dt / step)
    if abs(factor * step - dt) < 1e-6 * dt:
        kept = slice(cut, len(t) - cut, factor)
        at, core = t[kept], {name: x[kept].copy() for name, x in core.items()}
    else:
        at = np.arange(t[cut], t[-cut - 1], dt)
        core = {name: by_column(lambda x: CubicSpline(t, x)(at), y) for name, y in core.items()}
        core["reversal_path"] = by_column(lambda x: np.interp(at, t, x), path)
    static = bool(np.abs(core["dq"]).max() < slow)
    return Segment(log=number, t=at, **core, static=static)


def _poses(number: int, log: JointLog) -> Segment:
    """Return poses as a segment at rest."""
    t, q, tau, zero = log.t.copy(), log.q.copy(), log.tau.copy(), np.zeros_like(log.q)
    core = {"q": q, "dq": zero, "ddq": zero, "tau": tau, "reversal_path": q}
    return Segment(log=number, t=t, **core, static=True)


def _rest(segments: Sequence[Segment], dt: float, slow: float) -> list[str]:
    """Return how long the arm rests, if it rests for long."""
    moved = [s for s in segments if not s.static]
    count = sum(len(s.t) for s in moved)
    resting = sum(int((np.abs(s.dq).max(axis=1) < slow).sum()) for s in moved)
    if not count or resting < 0.1 * count:
        return []
    return [f"the arm rests in {resting / count:.0%} of the {count * dt:.3g} s"]
