"""Measures of a `Run` of the Generated Trajectory Experiment: errors, vibration, wear.

Errors are actual pose less reference, per axis x, y, z [m], roll, pitch, yaw [rad] of the hand's
frame: the Panda's flange starts with a yaw of −45°, in which errors about the base's x and y would
come out mixed (sources.md 1.1). The reference moves at once to where the arm is whenever a goal is
accepted (sources.md 6.2), so an error counts from the last corner on.

Table 4.11 (thesis 4.2) sums "the error values for each coordinate" over "200 data points", "from 1
second before the last accepted new point to 1 second after". Here these are the absolute values,
and then the mean over iterations; the last accepted point is the last purple line of Figures 4.7
and 4.8, where the arm turns at the last corner but one: both regimes that the text names, "arriving
and moving from a point". Samples before the record's begin count 0: the arm rested.

An experiment feeds a whole run at once, the environment one step at a time. Everything is added
sample by sample, arm by arm: the same bits however samples are cut into blocks.
"""

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import Arguments, compiled
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.experiments.gte.protocol import GTEProtocol, Run, load_gte_protocol


class Accumulator:
    """Sums over the samples of N arms since each arm was started.

    The motion lasts from the first goal's acceptance until the last goal is reached (until now for
    an arm that has not reached it). After the motion comes the tail, in which the arm rests.
    """

    def __init__(
        self, nsim: int, capacity: int, *, rate: float, window: float, tail: float
    ) -> None:
        """Make the sums of N arms with at most G = ``capacity`` goals each; `start` each.

        Args:
            nsim: number of arms.
            capacity: most goals G of a path.
            rate: samples per second [Hz].
            window: half the window of Table 4.11 [s].
            tail: time after the last goal that counts to the total [s].
        """
        self._rate, self._tail = rate, round(tail * rate)
        self._goals = np.ones(nsim, dtype=np.int64)
        self.count = np.zeros(nsim, dtype=np.int64)  # (N,) samples so far
        self._width = round(window * rate)
        self._ring = np.zeros((nsim, 2 * self._width, 6))
        self._window_end = np.full(nsim, np.nan)
        self.window_sum = np.full((nsim, 6), np.nan)
        """(N, 6) absolute error summed over the window of Table 4.11, about the last goal's
        acceptance; NaN while it is not complete [m·samples, rad·samples]."""
        self.step_error, self.total_error = np.zeros((2, nsim, 6))
        """(N, 6) absolute error summed until the end of the tail: over the samples fed last, and
        over all [m, rad]."""
        self.maximum = np.zeros((nsim, 6))  # (N, 6) largest absolute error of the motion [m, rad]
        self.settling = np.full((nsim, capacity, 6), np.nan)
        """(N, G, 6) what is left of the error when the arm's time at a goal is over: in the last
        sample before the next goal was accepted, for the last goal in that of the tail; NaN before,
        and behind the last goal of a shorter path [m, rad]."""
        self.last = np.zeros((nsim, 6))  # (N, 6) error of the last sample [m, rad]
        self.over = np.zeros(nsim, dtype=bool)  # (N,) whether the tail is over
        self._tailing = np.zeros(nsim, dtype=bool)
        self._moving = np.zeros(nsim, dtype=np.int64)
        self._absolute, self._squares = np.zeros((2, nsim, 6))
        self._shaken, self._shaken_at_rest = np.zeros((2, nsim, 6))
        self._power = np.zeros(nsim)

    def start(self, ids: Index, goals: Index) -> None:
        """Restart arms ``ids``, whose paths have ``goals`` (M,) goals."""
        self._goals[ids] = goals
        self._ring[ids] = 0.0  # the arm rested with its reference where it was
        self._window_end[ids] = self.window_sum[ids] = self.settling[ids] = np.nan
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
            mean_square: (N, 6, S) of the vibration: positions, then turns times a lever [m²].
            accepted: (N, G) when goals were accepted, NaN where not yet [s].
            reached: (N, G) when they were reached [s].
            power: (N, S) of the dither, None where it is not asked for [W].
        """
        rows, last = np.arange(len(error)), self._goals - 1
        # samples are counted: their times and those of goals may differ by rounding
        end = np.rint(reached[rows, last] * self._rate)
        self._window_end[:] = np.rint(accepted[rows, last] * self._rate) + self._width
        _add_window(error, self.count, self._window_end, self._ring, self.window_sum)
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
        """End the samples: windows and tails that are still open keep the last error."""
        held = np.repeat(self.last[:, None], self._width, axis=1)
        _add_window(held, self.count, self._window_end, self._ring, self.window_sum)
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
        """(N, G, 2) `settling` as distance [m] and angle [rad], its small angles a vector's."""
        parts = self.settling[..., :3], self.settling[..., 3:]
        return np.stack([np.sqrt((part**2).sum(axis=-1)) for part in parts], axis=-1)

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


class Measures(Accumulator):
    """All measures of a run of I iterations with G goals, iteration by iteration."""

    def __init__(
        self, run: Run, protocol: GTEProtocol | None = None, motion: MotionLimits | None = None
    ) -> None:
        """Measure a run, with a protocol's window and tail and a motion's tolerances."""
        protocol, motion = protocol or load_gte_protocol(), motion or MotionLimits()
        count, goals = run.accepted.shape
        rate = 1.0 / sample_period(run)
        super().__init__(count, goals, rate=rate, window=protocol.window, tail=protocol.tail)
        self.start(np.arange(count), np.full(count, goals))
        self.feed(
            run.error,
            np.ascontiguousarray(run.mean_square.transpose(0, 2, 1)),
            run.accepted,
            run.reached,
            run.dither_power,
        )
        self.close()
        self.torque_rate = run.torque_rate.max(axis=1)
        """(I,) largest change of torque on any joint, a measure of wear [N·m/s]."""
        self.duration = run.reached[:, -1]  # (I,) when the last goal was reached [s]
        self.missed = ~(self.left <= [motion.position_tolerance, motion.rotation_tolerance]).all(-1)
        """(I, G) whether `settling` is beyond the generator's tolerance, so that only its patience
        ended the goal; roll, pitch and yaw errors are added as a vector."""

    @property
    def corner(self) -> Array:
        """(I, G − 1, 6) error when each new goal was accepted, in the last sample before the
        reference went to the measured pose. None for the first goal: there it is 0 by definition
        [m, rad]."""
        return self.settling[:, :-1]


def error_against_time(run: Run) -> tuple[Array, Array]:
    """Return mean and standard deviation of the error over iterations, (K, 6) each [m, rad].

    The deviation is 0 for a single iteration (Figures 4.7, 4.8, F.1 and F.2).
    """
    error = run.error
    return error.mean(axis=0), error.std(axis=0, ddof=min(1, len(error) - 1))


def sample_period(run: Run) -> float:
    """Return the time between two samples [s]; a run has at least two."""
    return float(run.time[1] - run.time[0])


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
