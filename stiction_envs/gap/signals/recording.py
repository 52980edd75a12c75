"""Measured data: signals of all logs in one piece, and what follows from them alone."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import csr_array

from stiction_envs.arrays import Array, Index
from stiction_envs.filters import lowpass
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from stiction_envs.robots import Arm

BLOCKS = 12
"""Blocks of time, over all logs, that are held out in turn: enough to see their spread; assumed."""
LEAST_BLOCKS = 4
"""The same of short logs: one of each fold [-]."""
GUARD = 0.25
"""Time between two blocks that belongs to neither [s]; assumed."""
Derived = TypeVar("Derived", bound=NDArray[np.floating])


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording(Signals):
    """Signals of an arm.

    Values derived from a recording are stored with it (`rigid`, `gravity`, `derived`). To change a
    field, make another recording (`dataclasses.replace`), which has no derived values yet.
    """

    arm: Arm
    """The nominal rigid arm."""
    pinocchio: pin.Model
    """The nominal rigid arm as a pinocchio model."""
    torque: str
    """Side of the gear on which torque was measured: "motor" or "link"."""
    since_log: Array
    """(T,) time since the log's first row [s]; the number of a pose."""
    since_session: Array
    """(T,) time since the first row of the log's session [s]; `since_log` without sessions."""
    block: Index
    """(T,) number of the block that is held out together, −1 in a guard."""
    link_factor: Array | None = None
    """(10 n, k) F, F Fᵀ being the covariance of the links' inertial parameters about the arm's, as
    an earlier diagnosis left it; None for the tolerance of CAD."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

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
        """Return ``make(self, *arguments)``; the last result of each function is kept."""
        kept = self._derived.get(make)
        if kept is None or kept[0] != arguments:
            self._derived.pop(make, None)  # two results at once take too much memory
            kept = self._derived[make] = arguments, make(self, *arguments)
        return cast(Derived, kept[1])

    def bristles(self, distance: Array) -> Array:
        """Return (F, n, k) unfiltered `bristles` of presliding distances (n, k) [rad]."""
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
                weight[path, 0] = 1.0
                column[path, 0] = run.start + np.searchsorted(here, at + here[0])
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

        ``x`` is (F, ...) along the reversal path, or (T, ...). Nonlinear functions of the signals
        must pass the filter before a comparison.
        """
        out = np.array(x, dtype=np.float64)
        fine = len(x) == len(self.reversal_path)
        dt, runs = (self.path_dt, self.path_runs) if fine else (self.dt, self.runs)
        if np.isfinite(dt) and np.isfinite(self.cutoff):
            for run in (x for x in runs if x.stop - x.start > 1):
                out[run] = lowpass(out[run], 1 / dt, self.cutoff)
        return out[self.path_rows] if fine else out


def join(arm: Arm, signals: Signals, *, torque: str, link_factor: Array | None = None) -> Recording:
    """Return the signals as those of an arm; see `Recording` for the arguments."""
    log, when = signals.log, signals.sessions
    since_log = signals.t - when.start[log]
    return Recording(
        **{x.name: getattr(signals, x.name) for x in fields(signals)},
        arm=arm,
        pinocchio=arm.pinocchio(),
        torque=torque,
        since_log=since_log,
        since_session=since_log + when.since[log],
        block=_blocks(log, signals.segment, signals.dt),
        link_factor=link_factor,
    )


def rate(x: Array, runs: list[slice], dt: float) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    out = np.zeros_like(x)
    for run in runs:
        if run.stop - run.start > 2:
            out[run] = np.gradient(x[run], dt, axis=0)
    return out


def _blocks(log: Index, segment: Index, dt: float) -> Index:
    """Return (T,) block numbers: one per log for many logs, else equal spans of each log's time.

    Blocks are never random rows: neighbours share noise, filter and friction state.
    """
    logs = np.unique(log)
    least, most = (max(1, -(-x // len(logs))) for x in (LEAST_BLOCKS, BLOCKS))
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
