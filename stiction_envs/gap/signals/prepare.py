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
  filtered acceleration, √(S (2π)⁴ f⁵/5) for white noise S of the angle, stays small: the model's
  inertial torque has it, and a delay or a spring would be named because it smooths that torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError
from stiction_envs.filters import lowpass
from stiction_envs.gap.signals.angles import AngleError
from stiction_envs.gap.signals.reversals import WIDER, reversal_path
from stiction_envs.gap.signals.sessions import Sessions, sessions
from stiction_envs.gap.signals.spectra import PERIODS, Spectra, by_column, resample
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion_thresholds import REST_SPEED
from stiction_envs.reporting.markdown import plural

Fields = dict[str, Any]
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
class Signals:
    """T samples of n joints: all segments of all logs, one after the other; arrays are read-only.

    A segment is a stretch without gaps on even times, or one pose.
    """

    t: Array
    """(T,) time on the log's clock [s]; the number of a pose."""
    q: Array
    """(T, n) angles [rad]."""
    dq: Array
    """(T, n) speeds [rad/s]."""
    ddq: Array
    """(T, n) accelerations [rad/s²]."""
    tau: Array
    """(T, n) measured torques [N·m]."""
    log: Index
    """(T,) number of the log, from 0."""
    segment: Index
    """(T,) number of the segment."""
    static: Bools
    """(T,) whether the segment is at rest throughout: a pose, or never faster than `REST_SPEED`."""
    reversal_path: Array
    """(F, n) angles without overshoot or reversals caused by noise [rad], for friction's reversals
    (`filters`): at finer times, since a turn within a time step shows in the filtered torque, and
    from before a segment's start to after its end."""
    path_rows: Index
    """(T,) row of the reversal path at each time."""
    path_segment: Index
    """(F,) number of the segment."""
    dt: float
    """Time between samples of a segment [s]; NaN for poses alone."""
    every: int = 1
    """Rows of the reversal path per sample."""
    cutoff: float
    """Cutoff of the filter, where the amplitude is halved [Hz]; NaN for poses alone."""
    noise_tau: Array
    """(n,) standard deviation of the noise of the filtered torques [N·m]."""
    sessions: Sessions
    """When the logs were recorded."""
    notes: tuple[str, ...]
    """How the signals were computed, one sentence each."""
    torque_sign: int = 0
    """1 where the torques drive the joints, -1 where all were inverted; 0 where unknown."""
    torque_unit: Array = field(default_factory=lambda: np.ones(1))
    """(n,) what 1 N·m is in the unit of the logged torques; (1,) where it is the same for all."""
    measured: Bools | None = None
    """(n,) whether each torque is a measurement; None for all."""
    findings: tuple[str, ...] = ()
    """Defects of units, channels and mounting, one sentence each."""
    set_up: bool = False
    """Whether the arm is mounted otherwise, or a joint turns the other way: no cause is named."""
    zero_off: AngleError | None = None
    """A joint whose zero is far from the model's."""

    def __post_init__(self) -> None:
        for x in vars(self).values():
            if isinstance(x, np.ndarray):
                x.flags.writeable = False

    @property
    def path_dt(self) -> float:
        """Time between rows of the reversal path within a segment [s]; NaN for poses alone."""
        return self.dt / self.every

    @cached_property
    def runs(self) -> list[slice]:
        """Rows of each segment."""
        return _runs_of(self.segment)

    @cached_property
    def path_runs(self) -> list[slice]:
        """Rows of the reversal path of each segment."""
        return _runs_of(self.path_segment)


def _runs_of(segment: Index) -> list[slice]:
    """Return the rows of each segment from its number (T,)."""
    edges = np.flatnonzero(np.diff(segment)) + 1
    cuts = [0, *edges.tolist(), len(segment)]
    return [slice(a, b) for a, b in pairwise(cuts)]


def prepare(
    logs: Sequence[JointLog], *, cutoff_hz: float | None = None, most_samples: int = MOST_ROWS
) -> Signals:
    """Compute evenly sampled, filtered and differentiated signals of ``logs``.

    Args:
        logs: one or more logs of the same robot.
        cutoff_hz: cutoff of the filter, Hz; chosen from the data if None.
        most_samples: samples kept of all logs together, at most.

    Raises:
        StictionError: logs of different robots, a cutoff that is not positive, or no segment long
            enough for it.
    """
    for log in logs:
        if log.n != logs[0].n:
            raise StictionError(
                f"{log.source}: {log.n} joints, but {logs[0].source} has {logs[0].n}: "
                "expected logs of one robot"
            )
    if cutoff_hz is not None and not (np.isfinite(cutoff_hz) and cutoff_hz > 0):
        raise StictionError(f"cutoff {cutoff_hz} Hz: expected numbers above 0")
    moving = [(i, log) for i, log in enumerate(logs) if not log.static]
    pieces = [(i, _poses(log)) for i, log in enumerate(logs) if log.static]
    if not moving:
        return Signals(
            **_joined(pieces),
            dt=float("nan"),
            cutoff=float("nan"),
            noise_tau=np.full(logs[0].n, np.nan),
            sessions=sessions(logs),
            notes=("poses at rest only: nothing filtered",),
        )
    # without the last digits, which are rounding of the times
    steps = [float(f"{log.step:.6g}") for _, log in moving]
    notes: list[str] = []
    spectra = Spectra([log for _, log in moving], steps)
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
            made = _segment(log, rows, step, fine, every, cutoff)
            left_out += made is None
            pieces += [(i, made)] if made is not None else []
    if left_out:
        notes.append(
            f"{plural(left_out, 'segment')} shorter than {shortest:.3g} s left out: "
            "too short for the filter"
        )
    if all(logs[i].static for i, _ in pieces):
        raise StictionError(
            f"{moving[0][1].source}: no segment of {shortest:.3g} s "
            f"without a gap: expected one or more (cutoff {cutoff:.3g} Hz)"
        )
    if spectra.rounded().all():
        notes.append(
            "the torques are smooth down to the last digit: they were filtered before they were "
            "logged, and their noise is larger than it seems"
        )
    pieces.sort(key=lambda x: (x[0], x[1]["t"][0]))
    joined = _joined(pieces)
    notes += _rest(joined["dq"][~joined["static"]], dt)
    return Signals(
        **joined,
        dt=dt,
        every=every,
        cutoff=cutoff,
        noise_tau=spectra.noise(cutoff),
        sessions=sessions(logs),
        notes=tuple(notes),
    )


def _multiple(step: float, rate: float, most_rate: float) -> float:
    """Return the multiple of a step [s] that leaves a rate, but no more than another [Hz]."""
    return step * max(1, int(1 / (step * rate)), int(np.ceil(1 / (step * most_rate) - 1e-9)))


def _segment(
    log: JointLog, rows: slice, step: float, fine: float, every: int, cutoff: float
) -> Fields | None:
    """Return fields of `Signals` of some rows of a log; None if too short for the filter."""
    seconds = log.t[rows][-1] - log.t[rows][0]
    # One period of margin for the rounding of the longest segment's own cutoff.
    if seconds < (PERIODS - 1) / cutoff or rows.stop - rows.start < 16:
        return None
    t, q, tau = resample(log, rows, step)
    path = by_column(lambda x: reversal_path(x, 1 / step, cutoff), q)
    q, tau = lowpass(q, 1 / step, cutoff), lowpass(tau, 1 / step, cutoff)
    moved = q - q[0]  # so that a joint that rests does so to the bit
    dq = by_column(lambda x: np.convolve(x, _FIRST[::-1], "same") / step, moved)
    ddq = by_column(lambda x: np.convolve(x, _SECOND[::-1], "same") / step**2, moved)
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
    t, q, dq, ddq, tau = (x[rows] for x in (t, q, dq, ddq, tau))
    return {
        "t": t,
        "q": q,
        "dq": dq,
        "ddq": ddq,
        "tau": tau,
        "segment": np.zeros(len(t), np.int64),
        "static": np.full(len(t), np.abs(dq).max() < REST_SPEED),
        "reversal_path": path,
        "path_rows": first + every * np.arange(len(t)),
        "path_segment": np.zeros(len(path), np.int64),
    }


def _poses(log: JointLog) -> Fields:
    """Return fields of `Signals` of poses, each a segment at rest."""
    zero, number = np.zeros_like(log.q), np.arange(len(log.t))
    return {
        "t": log.t,
        "q": log.q,
        "dq": zero,
        "ddq": zero,
        "tau": log.tau,
        "segment": number,
        "static": np.ones(len(log.t), bool),
        "reversal_path": log.q,
        "path_rows": number,
        "path_segment": number,
    }


def _joined(pieces: Sequence[tuple[int, Fields]]) -> Fields:
    """Return the fields of all pieces in one; each piece has the number of its log."""
    path_row = segment = 0
    for number, piece in pieces:
        piece["log"] = np.full(len(piece["t"]), number)
        piece["path_rows"] = piece["path_rows"] + path_row
        piece["path_segment"] = piece["path_segment"] + segment
        piece["segment"] = piece["segment"] + segment
        path_row += len(piece["reversal_path"])
        segment = int(piece["segment"][-1]) + 1
    return {name: np.concatenate([x[name] for _, x in pieces]) for name in pieces[0][1]}


def _rest(dq: Array, dt: float) -> list[str]:
    """Return how long the arm rests, if it rests for long; speeds are (T, n) [rad/s]."""
    resting = int((np.abs(dq).max(axis=1) < REST_SPEED).sum())
    if not len(dq) or resting < 0.1 * len(dq):
        return []
    return [f"the arm rests in {resting / len(dq):.0%} of the {len(dq) * dt:.3g} s"]
