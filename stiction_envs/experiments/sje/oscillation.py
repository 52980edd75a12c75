"""How far dither shakes the joints of N arms while one of them still sticks."""

from __future__ import annotations

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.experiments.highpass import butterworth_highpass, filter_sections
from stiction_envs.plant import CONTROL_DT


class Oscillation:
    """Root mean square of the joints' angles above a corner frequency, step by step.

    Angles of all joints are added as a vector. A high-pass of fourth order (twice the Butterworth
    of second order) keeps out the joint that speeds up when it breaks away. Once the joint under
    test has moved by more than ``far`` from where its ramp found it, nothing counts any more.
    """

    def __init__(self, nsim: int, n: int, *, corner: float, far: float) -> None:
        """Prepare N arms of n joints; `start` each.

        Args:
            nsim: number of arms.
            n: joints of an arm.
            corner: where each of the two high-passes has the gain 1/√2 [Hz].
            far: angle of the joint under test at which the joint is on its way [rad].
        """
        self._band = np.repeat(butterworth_highpass(corner, 1.0 / CONTROL_DT), 2, axis=0)
        self._far = far
        self._state = np.zeros((len(self._band), nsim, n, 2))
        self._rest = np.zeros((nsim, n))
        self._joint = np.zeros(nsim, dtype=np.int64)
        self._gone = np.zeros(nsim, dtype=bool)
        self._squares, self._count = np.zeros((2, nsim))
        self._all_squares, self._all_count = np.zeros((2, nsim))

    def start(self, ids: Index, angle: Array, joint: Index) -> None:
        """Restart arms ``ids`` that rest at ``angle`` (M, n) [rad]; tested is ``joint``."""
        self._state[:, ids], self._rest[ids], self._joint[ids] = 0.0, angle, joint
        self._gone[ids] = False
        for total in (self._squares, self._count, self._all_squares, self._all_count):
            total[ids] = 0.0

    def begin_step(self, ids: Index) -> None:
        """Begin an environment step of arms ``ids``."""
        self._squares[ids] = self._count[ids] = 0.0

    def add(self, ids: Index, angle: Array) -> None:
        """Take the next angles (M, K, n) of arms ``ids``, one per control step [rad]."""
        moved = np.ascontiguousarray((angle - self._rest[ids][:, None]).transpose(0, 2, 1))
        mine = np.abs(moved[np.arange(len(ids)), self._joint[ids]])
        state = np.ascontiguousarray(self._state[:, ids])
        filter_sections(self._band, moved, state)
        self._state[:, ids] = state
        gone = np.logical_or.accumulate(mine >= self._far, axis=1) | self._gone[ids][:, None]
        self._gone[ids] = gone[:, -1]
        squares = np.where(gone, 0.0, (moved**2).sum(axis=1)).sum(axis=1)
        count = (~gone).sum(axis=1)
        self._squares[ids] += squares
        self._count[ids] += count
        self._all_squares[ids] += squares
        self._all_count[ids] += count

    def step_mean_square(self, ids: Index) -> Array:
        """Return (M,) mean square of the last step, 0 where nothing counted [rad²]."""
        return self._squares[ids] / np.maximum(self._count[ids], 1.0)

    def episode_rms(self, ids: Index) -> Array:
        """Return (M,) root mean square since the start [rad]."""
        return np.sqrt(self._all_squares[ids] / np.maximum(self._all_count[ids], 1.0))
