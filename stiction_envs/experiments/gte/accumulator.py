"""Errors and shaking of N arms on their paths, added up while samples come in.

The experiment feeds a whole run at once (`measures.measure`), the environment one step at a time.
Everything is added sample by sample, arm by arm: the same bits however samples are cut into blocks.
"""

from __future__ import annotations

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import Arguments, compiled


class ErrorWindow:
    """The error within some samples of a moment that is known only when it has come.

    Samples before the first count 0: the arm rested with its reference where it was.
    """

    def __init__(self, nsim: int, width: int) -> None:
        """Make windows of ``width`` samples on either side."""
        self._width = width
        self._ring = np.zeros((nsim, 2 * width, 6))
        self._end = np.full(nsim, np.nan)
        self.sum = np.full((nsim, 6), np.nan)
        """(N, 6) absolute error summed over the window, NaN while it is not complete [m, rad]."""

    def start(self, ids: Index) -> None:
        """Restart arms ``ids``."""
        self._ring[ids] = 0.0
        self._end[ids] = self.sum[ids] = np.nan

    def add(self, error: Array, first: Index, centre: Array) -> None:
        """Take errors (N, S, 6), the first of which are samples ``first`` (N,) of their arms.

        ``centre`` (N,) is the sample in the middle, NaN where it is not known yet.
        """
        self._end[:] = centre + self._width
        _add_window(error, first, self._end, self._ring, self.sum)

    def close(self, last: Array, count: Index) -> None:
        """Hold the last errors (N, 6) where ``count`` (N,) samples end before the window does."""
        held = np.repeat(last[:, None], self._width, axis=1)
        _add_window(held, count, self._end, self._ring, self.sum)

    @property
    def error(self) -> Array:
        """(N, 2 width, 6) errors of the complete windows, in order; NaN for the others [m, rad]."""
        out = np.full(self._ring.shape, np.nan)
        length = self._ring.shape[1]
        for i in np.flatnonzero(np.isfinite(self.sum[:, 0])):
            out[i] = np.roll(self._ring[i], -(int(self._end[i]) % length), axis=0)
        return out


class Accumulator:
    """What N arms did since each of them was started.

    The motion is from the first goal's acceptance until the last goal was reached, all there is
    where it was not reached yet; the tail, in which the arm rests, comes behind it.
    """

    def __init__(
        self, nsim: int, capacity: int, *, rate: float, window: float, tail: float
    ) -> None:
        """Make it for N arms; `start` each.

        Args:
            nsim: number of arms.
            capacity: most goals G of a path.
            rate: of the samples [Hz].
            window: half the window of Table 4.11 [s].
            tail: time after the last goal that counts to the total [s].
        """
        self._rate, self._tail = rate, round(tail * rate)
        self._goals = np.ones(nsim, dtype=np.int64)
        self.count = np.zeros(nsim, dtype=np.int64)
        """(N,) samples so far."""
        self.window = ErrorWindow(nsim, round(window * rate))
        """Window of Table 4.11, about the last goal's acceptance."""
        self.step_error, self.total_error = np.zeros((2, nsim, 6))
        """(N, 6) absolute error summed until the end of the tail: over the samples fed last, and
        over all [m, rad]."""
        self.maximum = np.zeros((nsim, 6))
        """(N, 6) largest absolute error of the motion [m, rad]."""
        self.settling = np.full((nsim, capacity, 6), np.nan)
        """(N, G, 6) what is left of the error when the arm's time at a goal is over: in the last
        sample before the next goal was accepted, for the last goal in that of the tail; NaN before,
        and behind the last goal of a shorter path [m, rad]."""
        self.last = np.zeros((nsim, 6))
        """(N, 6) error of the last sample [m, rad]."""
        self.over = np.zeros(nsim, dtype=bool)
        """(N,) whether the tail is over."""
        self._tailing = np.zeros(nsim, dtype=bool)
        self._moving = np.zeros(nsim, dtype=np.int64)
        self._absolute, self._squares = np.zeros((2, nsim, 6))
        self._shaken, self._shaken_at_rest = np.zeros((2, nsim, 6))
        self._power = np.zeros(nsim)

    def start(self, ids: Index, goals: Index) -> None:
        """Restart arms ``ids``, whose paths have ``goals`` (M,) goals."""
        self._goals[ids] = goals
        self.window.start(ids)
        self.settling[ids] = np.nan
        self.over[ids] = self._tailing[ids] = False
        for array in (self.count, self.last, *self._sums):
            array[ids] = 0

    def feed(
        self,
        error: Array,
        mean_square: Array,
        accepted: Array,
        reached: Array,
        power: Array | None = None,
    ) -> None:
        """Take the next samples of all arms.

        Args:
            error: (N, S, 6) pose less reference [m, rad].
            mean_square: (N, 6, S) of the vibration within each sample: of the position, then of
                turns times a lever [m²].
            accepted: (N, G) when goals were accepted, NaN where not yet [s].
            reached: (N, G) when they were reached [s].
            power: (N, S) of the dither, None where it is not asked for [W].
        """
        rows, last = np.arange(len(error)), self._goals - 1
        # samples are counted: their times and those of goals may differ by rounding
        end = np.rint(reached[rows, last] * self._rate)
        self.window.add(error, self.count, np.rint(accepted[rows, last] * self._rate))
        over = np.full(accepted.shape, np.nan)
        over[:, :-1] = np.rint(accepted[:, 1:] * self._rate)
        over[rows, last] = end + self._tail
        power = np.zeros(error.shape[:2]) if power is None else power
        _take_samples(error, np.maximum(over - 1.0, 0.0), self.count, self.last, self.settling)
        _add_samples(error, mean_square, power, self.count, end, end + self._tail, self._sums)
        self.last[:] = error[:, -1]
        self.count += error.shape[1]
        self._tailing = np.isfinite(end)
        self.over = self.count >= np.where(np.isnan(end), np.inf, end + self._tail)

    def close(self) -> None:
        """There are no more samples: windows and tails that are still open hold the last error."""
        self.window.close(self.last, self.count)
        rows = np.flatnonzero(self._tailing & ~self.over)
        self.settling[rows, self._goals[rows] - 1] = self.last[rows]

    @property
    def _sums(self) -> Arguments:
        """All that `_add_samples` writes, in its order."""
        return (
            *(self._moving, self.step_error, self.total_error),
            *(self._absolute, self._squares, self.maximum),
            *(self._shaken, self._shaken_at_rest, self._power),
        )

    @property
    def left(self) -> Array:
        """(N, G, 2) `settling` as distance [m] and angle [rad]."""
        return distance_and_angle(self.settling)

    @property
    def mean(self) -> Array:
        """(N, 6) mean absolute error of the motion [m, rad]."""
        return self._absolute / self._moving[:, None]

    @property
    def rms(self) -> Array:
        """(N, 6) root mean square error of the motion [m, rad]."""
        return np.sqrt(self._squares / self._moving[:, None])

    @property
    def vibration(self) -> Array:
        """(N, 6) root mean square vibration of the motion: of the position, then of turns times the
        lever; 0 before the first sample [m]."""
        return np.sqrt(self._shaken / np.maximum(self._moving, 1)[:, None])

    @property
    def vibration_at_rest(self) -> Array:
        """(N, 6) the same after the last goal was reached, until the tail ends; NaN before [m]."""
        rest = np.minimum(self.count - self._moving, self._tail)
        return np.sqrt(self._shaken_at_rest / np.where(rest > 0, rest, np.nan)[:, None])

    @property
    def shaking(self) -> Array:
        """(N,) root mean square of the motion's vibration, directions and turns together [m]."""
        return np.sqrt((self.vibration**2).sum(axis=1))

    @property
    def shaking_at_rest(self) -> Array:
        """(N,) the same at rest, after the last goal was reached; NaN before [m]."""
        return np.sqrt((self.vibration_at_rest**2).sum(axis=1))

    @property
    def dither_energy(self) -> Array:
        """(N,) what the dither moved back and forth during the motion [J]."""
        return self._power / self._rate


def distance_and_angle(error: Array) -> Array:
    """Return (..., 2) of errors (..., 6): the position's length [m], and the angle [rad].

    Roll, pitch and yaw errors are small and added as a vector.
    """
    parts = (error[..., :3], error[..., 3:])
    return np.stack([np.sqrt((part**2).sum(axis=-1)) for part in parts], axis=-1)


# NaN, not known yet, is never passed: all comparisons with it are false


@compiled
def _add_samples(
    error: Array,
    mean_square: Array,
    power: Array,
    first: Index,
    motion_end: Array,
    tail_end: Array,
    sums: Arguments,
) -> None:
    """Add the samples of `Accumulator.feed`, the first of which are numbers ``first`` (N,)."""
    moving, step, total, absolute, squares, maximum, shaken, shaken_at_rest, work = sums
    for i in range(error.shape[0]):
        for a in range(6):
            step[i, a] = 0.0
        for s in range(error.shape[1]):
            k = first[i] + s
            in_motion, counted = not k >= motion_end[i], not k >= tail_end[i]
            for a in range(6):
                e = error[i, s, a]
                if counted:
                    step[i, a] += abs(e)
                    total[i, a] += abs(e)
                if in_motion:
                    absolute[i, a] += abs(e)
                    squares[i, a] += e * e
                    maximum[i, a] = max(maximum[i, a], abs(e))
            for a in range(6):
                if in_motion:
                    shaken[i, a] += mean_square[i, a, s]
                elif counted:
                    shaken_at_rest[i, a] += mean_square[i, a, s]
            if in_motion:
                moving[i] += 1
                work[i] += power[i, s]


@compiled
def _take_samples(error: Array, at: Array, first: Index, last: Array, out: Array) -> None:
    """Write the errors (N, G, 6) of samples ``at`` (N, G), NaN for none, of these or the last."""
    for i in range(at.shape[0]):
        for g in range(at.shape[1]):
            if not np.isfinite(at[i, g]):
                continue
            s = int(at[i, g]) - first[i]
            for a in range(6):
                if 0 <= s < error.shape[1]:
                    out[i, g, a] = error[i, s, a]
                elif s == -1:
                    out[i, g, a] = last[i, a]


@compiled
def _add_window(error: Array, first: Index, end: Array, ring: Array, total: Array) -> None:
    """Write errors (N, S, 6) into the rings until their ends (N,), where they are summed."""
    length = ring.shape[1]
    for i in range(error.shape[0]):
        for s in range(error.shape[1]):
            k = first[i] + s
            if k >= end[i]:
                break
            for a in range(6):
                ring[i, k % length, a] = error[i, s, a]
            if k + 1 >= end[i]:
                for a in range(6):
                    total[i, a] = 0.0
                    for m in range(length):
                        total[i, a] += abs(ring[i, (k + 1 + m) % length, a])
