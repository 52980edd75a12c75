"""Measured data: signals of all logs in one piece, and what follows from them alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar, cast

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import csr_array

from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.prepare import Signals, lowpass
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
BLOCKS = 12
"""Blocks of time, over all logs, that are held out in turn: enough to see their spread; assumed."""
LEAST_BLOCKS = 4
"""The same of short logs: one of each fold [-]."""
GUARD = 0.25
"""Time between two blocks that belongs to neither [s]; assumed."""
Derived = TypeVar("Derived", bound=NDArray[np.floating])


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """T samples of n joints, read-only.

    Values derived from a recording are stored with it (`rigid`, `gravity`, `derived`). To change a
    field, make another recording (`dataclasses.replace`), which has no derived values yet.
    """

    arm: Arm
    """The nominal rigid arm."""
    pinocchio: pin.Model
    """The nominal rigid arm as a pinocchio model."""
    torque: str
    """Side of the gear on which torque was measured: "motor" or "link"."""
    dt: float
    """Sampling time within a segment [s]; NaN for poses alone."""
    cutoff: float
    """Cutoff of the filter that all signals passed [Hz]."""
    t: Array
    """(T,) time since the start of the log [s]."""
    since_log: Array
    """(T,) time since the log's first row [s]; the number of a pose."""
    since_session: Array
    """(T,) time since the first row of the log's session [s]; since that of the log where the
    clocks do not show sessions."""
    common_clock: bool
    """Whether there are several logs whose clocks show when each was recorded."""
    q: Array
    """(T, n) [rad]."""
    dq: Array
    """(T, n) [rad/s]."""
    ddq: Array
    """(T, n) [rad/s²]."""
    tau: Array
    """(T, n) measured [N·m]."""
    reversal_path: Array
    """(F, n) angles without overshoot and noise, for friction's turns [rad]: at finer times, since
    a turn within a time step shows in the filtered torque."""
    path_rows: NDArray[np.int64]
    """(T,) row of the reversal path at each time."""
    path_dt: float
    """Sampling time of the reversal path within a segment [s]; NaN for poses alone."""
    path_segment: NDArray[np.int64]
    """(F,) number of the segment."""
    segment: NDArray[np.int64]
    """(T,) number of the segment: time runs on within one."""
    block: NDArray[np.int64]
    """(T,) number of the block that is held out together, −1 in a guard."""
    log: NDArray[np.int64]
    """(T,) number of the log, from 0."""
    link_factor: Array | None = None
    """(10 n, k) F, F Fᵀ being the covariance of the links' inertial parameters about the arm's, as
    an earlier diagnosis left it; None for the tolerance of CAD."""

    def __post_init__(self) -> None:
        for x in vars(self).values():
            if isinstance(x, np.ndarray):
                x.flags.writeable = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @cached_property
    def runs(self) -> list[slice]:
        """Rows of each segment."""
        return runs_of(self.segment)

    @cached_property
    def path_runs(self) -> list[slice]:
        """Rows of the reversal path of each segment."""
        return runs_of(self.path_segment)

    @cached_property
    def rigid(self) -> Array:
        """(T, n) torque of the rigid arm along the motion [N·m]."""
        return inverse_dynamics(self.pinocchio, self.q, self.dq, self.ddq)

    @cached_property
    def gravity(self) -> Array:
        """(T, n) gravity torque of the rigid arm [N·m]."""
        return gravity_torque(self.pinocchio, self.q)

    @cached_property
    def _derived(self) -> dict[Callable[..., Any], tuple[tuple[float, ...], Any]]:
        return {}

    def derived(self, make: Callable[..., Derived], *arguments: float) -> Derived:
        """Return ``make(self, *arguments)``, computed only once because it may be expensive.

        Args:
            make: a function of a module; only its last result is kept.
            arguments: numbers.
        """
        kept = self._derived.get(make)
        if kept is None or kept[0] != arguments:
            self._derived.pop(make, None)  # two results at once take too much memory
            kept = self._derived[make] = arguments, make(self, *arguments)
        return cast(Derived, kept[1])

    def bristles(self, distance: Array) -> Array:
        """Return (F, n, k) `bristles` along the reversal path, unfiltered [-].

        Args:
            distance: (n, k) presliding distances [rad].
        """
        return bristles(self.reversal_path, self.path_runs, distance)

    def along_path(self, x: Array) -> Array:
        """Return (F, ...) of smooth (T, ...), at the times of the reversal path.

        Before the first row of a segment and after its last it is constant.
        """
        flat = self._finer @ x.reshape(len(x), -1)
        return np.asarray(flat.reshape(-1, *x.shape[1:]))

    @cached_property
    def _finer(self) -> csr_array:
        """(F, T) weights of cubic interpolation (Lagrange's, through the four nearest rows)."""
        weight, column = np.zeros((2, len(self.reversal_path), 4))
        for run, path in zip(self.runs, self.path_runs, strict=True):
            rows, here = run.stop - run.start, self.path_rows[run]
            at = np.clip(np.arange(path.start, path.stop), here[0], here[-1]) - here[0]
            if rows < 4:  # poses; shorter segments are none
                weight[path, 0], column[path, 0] = (
                    1.0,
                    run.start + np.searchsorted(here, at + here[0]),
                )
                continue
            at = at / (here[1] - here[0])
            base = np.clip(at.astype(int), 1, rows - 3)
            u = at - base
            column[path] = run.start + base[:, None] + np.arange(-1, 3)
            low, high = (u + 1) * u, (u - 1) * (u - 2)
            each = (-u * high / 6, (u + 1) * high / 2, -low * (u - 2) / 2, low * (u - 1) / 6)
            weight[path] = np.stack(each, axis=1)
        ends = np.arange(0, weight.size + 1, 4)
        shape = len(weight), len(self.t)
        return csr_array((weight.ravel(), column.ravel().astype(np.int64), ends), shape=shape)

    def path_rate(self, x: Array) -> Array:
        """Return the time derivative of (F, ...) along the reversal path, per second."""
        return rate(x, self.path_runs, self.path_dt)

    def smooth(self, x: Array) -> Array:
        """Return (T, ...) after the filter of the signals, by segment; poses are unchanged.

        Nonlinear functions of the signals must pass it before a comparison.

        Args:
            x: (F, ...) along the reversal path, or (T, ...).
        """
        out = np.array(x, dtype=np.float64)
        fine = len(x) == len(self.reversal_path)
        dt, runs = (self.path_dt, self.path_runs) if fine else (self.dt, self.runs)
        if np.isfinite(dt) and np.isfinite(self.cutoff):
            for run in (x for x in runs if x.stop - x.start > 1):
                out[run] = lowpass(out[run], 1 / dt, self.cutoff)
        return out[self.path_rows] if fine else out


def join(arm: Arm, signals: Signals, *, torque: str, link_factor: Array | None = None) -> Recording:
    """Put the segments of all logs of an arm into one piece.

    ``torque`` is the side of the gear on which torque was measured, "motor" or "link",
    ``link_factor`` (10 n, k) what an earlier diagnosis knows of the links.
    """
    parts = signals.segments
    q, dq, ddq, tau, path = (
        np.concatenate([getattr(s, x) for s in parts])
        for x in ("q", "dq", "ddq", "tau", "reversal_path")
    )
    log = np.concatenate([np.full(len(s.t), s.log) for s in parts])
    when = signals.sessions
    since_log = np.concatenate([s.t - when.start[s.log] for s in parts])
    segment, path_segment, path_rows = _numbers(signals)
    return Recording(
        arm=arm,
        pinocchio=arm.pinocchio(),
        torque=torque,
        dt=signals.dt,
        cutoff=signals.cutoff_hz,
        t=np.concatenate([s.t for s in parts]),
        since_log=since_log,
        since_session=since_log + when.since[log],
        common_clock=when.common_clock,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        reversal_path=path,
        path_rows=path_rows,
        path_dt=signals.dt / signals.every,
        path_segment=path_segment,
        segment=segment,
        block=_blocks(log, segment, signals.dt, BLOCKS),
        log=log,
        link_factor=link_factor,
    )


def _numbers(signals: Signals) -> tuple[NDArray[np.int64], ...]:
    """Return (T,) segment of each row, (F,) that of each row of the reversal path, and (T,) the
    latter's row of each of the former. Each pose is a segment of its own.
    """
    segment, path_segment, path_rows = [], [], []
    number = start = 0
    for s in signals.segments:
        rows, fine = len(s.t), len(s.reversal_path)
        # poses have numbers instead of times
        poses = rows > 1 and s.static and not np.isclose(s.t[1] - s.t[0], signals.dt)
        each = np.arange(rows)
        segment.append(number + each if poses else np.full(rows, number))
        path_segment.append(segment[-1] if poses else np.full(fine, number))
        path_rows.append(start + s.first + each * (1 if poses else signals.every))
        number, start = number + (rows if poses else 1), start + fine
    return np.concatenate(segment), np.concatenate(path_segment), np.concatenate(path_rows)


def runs_of(segment: NDArray[np.int64]) -> list[slice]:
    """Return the rows of each segment from its number (T,)."""
    edges = np.flatnonzero(np.diff(segment)) + 1
    cuts = [0, *edges.tolist(), len(segment)]
    return [slice(a, b) for a, b in pairwise(cuts)]


def rate(x: Array, runs: list[slice], dt: float) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    out = np.zeros_like(x)
    for run in runs:
        if run.stop - run.start > 2:
            out[run] = np.gradient(x[run], dt, axis=0)
    return out


def _blocks(
    log: NDArray[np.int64], segment: NDArray[np.int64], dt: float, count: int
) -> NDArray[np.int64]:
    """Return (T,) block numbers: one per log for many logs, else equal spans of each log's time.

    Blocks are never random rows: neighbours share noise, filter and friction state.
    """
    logs = np.unique(log)
    least, most = (max(1, -(-x // len(logs))) for x in (LEAST_BLOCKS, count))
    block = np.empty(len(log), dtype=np.int64)
    guard = round(GUARD / dt) if np.isfinite(dt) else 0
    first = 0
    for number in logs:
        rows = np.flatnonzero(log == number)
        room = len(rows) // max(4 * guard, 1)  # of a shorter block, guards would leave too little
        each = max(least, min(most, room))
        part = np.minimum(np.arange(len(rows)) * each // len(rows), each - 1)
        block[rows] = first + part
        first += each
        for edge in np.flatnonzero(np.diff(part)) + 1:
            if segment[rows[edge]] != segment[rows[edge - 1]]:
                continue  # another recording or pose: not neighbours in time
            near = slice(max(0, edge - guard // 2), edge + guard // 2)
            block[rows[near]] = -1
    return block
