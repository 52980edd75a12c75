"""What the GTE environment measures while N arms move: tracking error, shaking, the window's sum.

The same quantities as `experiments.gte_measures`, kept up from step to step.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.rotation import to_rpy
from stiction_envs.experiments.gte.highpass import butterworth_highpass, filter_sections
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def pose_error(actual: Array, reference: Array) -> Array:
    """Return actual less reference, (..., 6) poses x, y, z [m], roll, pitch, yaw [rad].

    Angles are in (−π, π].
    """
    error: Array = actual - reference
    error[..., 3:] = np.angle(np.exp(1j * error[..., 3:]))
    return error


@dataclass
class PathTrace:
    """What one episode did over time, kept to be drawn; lists of one array per step."""

    time: list[Array] = field(default_factory=list)
    """(S,) of the samples [s]."""
    error: list[Array] = field(default_factory=list)
    """(S, 6) [m, rad]."""
    position: list[Array] = field(default_factory=list)
    """(S, 3) of the flange [m]."""
    amplitude: list[Array] = field(default_factory=list)
    """(1, n) of the step's dither [N·m]."""


class Recorder:
    """Advances a rig by environment steps and keeps account of each of its N arms."""

    def __init__(
        self, rig: GTERig, protocol: GTEProtocol, *, steps: int, capacity: int, record: bool
    ) -> None:
        """Prepare for environment steps of ``steps`` control steps.

        Args:
            rig: the arms.
            protocol: says what is sampled and when a run is over.
            steps: a multiple of the control steps of a sample.
            capacity: most goals of a path.
            record: whether traces are kept.
        """
        self._rig, self.record, self._capacity = rig, record, capacity
        nsim, rate = rig.nsim, protocol.sample_rate
        self._rate = rate
        self._stride = round(1.0 / (rate * CONTROL_DT))
        self._size = steps // self._stride
        self._width, self._tail = round(protocol.window * rate), round(protocol.tail * rate)
        self._band = butterworth_highpass(protocol.vibration_low, 1.0 / CONTROL_DT)
        self._state = np.zeros((len(self._band), nsim, 3, 2))
        self._still = np.zeros((nsim, 3))
        self._moved = np.zeros((steps, nsim, 3))
        self._poses = np.zeros((2, self._size, nsim, 7))
        self._tick = 0
        self._recent = np.zeros((nsim, 2 * self._width + self._size, 6))
        self._count = np.zeros(nsim, dtype=np.int64)
        self._square, self._moving = np.zeros((nsim, 3)), np.zeros(nsim)
        self.tracked = np.zeros((nsim, 6))
        """(N, 6) absolute error summed over the last step's samples [m, rad]."""
        self.total = np.zeros((nsim, 6))
        """(N, 6) the same over the episode so far."""
        self.vibration = np.zeros(nsim)
        """(N,) root mean square of the shaking in the last step [m]."""
        self.window_error = np.full((nsim, 6), np.nan)
        """(N, 6) absolute error summed over the window of Table 4.11 [m, rad]; NaN before."""
        self.over = np.zeros(nsim, dtype=bool)
        """(N,) the last goal was reached and the tail is over."""
        self.trace = [PathTrace() for _ in range(nsim)] if record else None

    @property
    def shaking(self) -> Array:
        """(N,) root mean square of the shaking over the motion so far [m]."""
        mean = self._square / np.maximum(self._moving, 1.0)[:, None]
        return np.sqrt(mean.sum(axis=1))

    def start(self, ids: Index) -> None:
        """Begin anew with arms ``ids``, which have just begun to follow."""
        self._still[ids] = self._rig.flange.position[ids]
        self._state[:, ids] = 0.0
        for array in (self._recent, self._square, self._moving, self.total, self.tracked):
            array[ids] = 0.0
        self._count[ids], self.vibration[ids], self.over[ids] = 0, 0.0, False
        self.window_error[ids] = np.nan
        if self.trace is not None:
            for i in ids:
                self.trace[i] = PathTrace()

    def advance(self, goals: Index) -> None:
        """Let all arms follow for one environment step; ``goals`` (N,) is how many they have."""
        self._tick = 0
        self._rig.advance(len(self._moved), self._watch)
        rows, last = np.arange(len(goals)), goals - 1
        keeper = self._rig.keeper
        reached = np.rint(keeper.reached_at[rows, last] * self._rate)
        index = self._count + np.arange(self._size)[:, None]  # (S, N) of the samples
        self._take_error(index, reached)
        self._take_shaking(index, reached)
        self._count += self._size
        self.over = self._count >= np.where(np.isnan(reached), np.inf, reached + self._tail)
        self._close_windows(np.rint(keeper.accepted_at[rows, last] * self._rate))

    def _watch(self) -> None:
        """One control step, before the arms move."""
        rig, k = self._rig, self._tick
        np.subtract(rig.flange.position, self._still, out=self._moved[k])
        if k % self._stride == 0:
            actual, reference = self._poses[:, k // self._stride]
            actual[:, :3], actual[:, 3:] = rig.flange.position, rig.flange.quaternion
            reference[:, :3], reference[:, 3:] = rig.controller.reference
        self._tick = k + 1

    def _take_error(self, index: Index, reached: Array) -> None:
        poses = np.concatenate([self._poses[..., :3], to_rpy(self._poses[..., 3:])], axis=-1)
        self._error = pose_error(poses[0], poses[1])
        counted = ~(index >= reached + self._tail)  # NaN, not reached yet: counted
        self.tracked = np.where(counted[..., None], np.abs(self._error), 0.0).sum(axis=0)
        self.total += self.tracked
        size = self._size
        self._recent[:, :-size] = self._recent[:, size:]
        self._recent[:, -size:] = self._error.transpose(1, 0, 2)

    def _take_shaking(self, index: Index, reached: Array) -> None:
        shaken = np.ascontiguousarray(self._moved.transpose(1, 2, 0))
        # the filter's state runs on from step to step
        filter_sections(self._band, shaken, self._state)
        shaken = shaken.reshape(*shaken.shape[:2], self._size, self._stride)
        square = np.mean(shaken**2, axis=-1)  # (N, 3, S)
        self.vibration = np.sqrt(square.mean(axis=-1).sum(axis=-1))
        moving = np.ascontiguousarray(~(index >= reached).T)
        self._square += np.where(moving[:, None], square, 0.0).sum(axis=-1)
        self._moving += moving.sum(axis=-1)

    def _close_windows(self, accepted: Array) -> None:
        """Sum the windows that this step completed; ``accepted`` (N,) is their middle sample."""
        end = accepted + self._width
        rows = np.flatnonzero((self._count >= end) & (self._count - self._size < end))
        if not len(rows):
            return
        length = 2 * self._width
        start = (end[rows] - self._count[rows]).astype(np.int64) + self._size
        window = self._recent[rows[:, None], start[:, None] + np.arange(length)]
        self.window_error[rows] = np.abs(window).sum(axis=1)

    def keep(self, ids: Index, amplitude: Array) -> None:
        """Add the last step of arms ``ids`` to their traces; ``amplitude`` (N, n) [N·m]."""
        assert self.trace is not None
        first = self._count - self._size
        for i in ids:
            trace = self.trace[i]
            trace.time.append((first[i] + np.arange(self._size)) / self._rate)
            trace.error.append(self._error[:, i].copy())
            trace.position.append(self._poses[0, :, i, :3].copy())
            trace.amplitude.append(amplitude[i : i + 1].copy())
