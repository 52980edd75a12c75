"""Measures of a `Run` of the Generated Trajectory Experiment: errors, vibration, wear.

Errors are actual pose less reference, per axis x, y, z [m], roll, pitch, yaw [rad]. Roll, pitch and
yaw are those of the hand's frame: the Panda's flange starts with a yaw of −45°, in which errors
about the base's x and y would come out mixed; its hand starts with 0 (sources.md 1.1).

The reference moves at once to where the arm is whenever a goal is accepted (sources.md 6.2), so an
error counts from the last corner on.

Table 4.11 (thesis 4.2) sums "the error values for each coordinate" over "200 data points", "from 1
second before the last accepted new point to 1 second after". What that leaves open, and what is
taken here:

* *sum of absolute values, then mean over iterations* (`Measures.window_sum`, which has a spread),
  or absolute value of the mean over iterations, then the sum (`Measures.window_sum_of_mean`). They
  differ only where the iterations' signs differ: the first is never the smaller.
* *the last accepted point*: when the last goal was accepted, the last purple line of Figures 4.7
  and 4.8. The arm then turns at the last corner but one and moves on: both regimes that the text
  names, "arriving and moving from a point". The other reading is when the last goal was reached.
* where the record begins less than 1 s before it: the arm rested with its reference where it was,
  so the missing samples count 0.
"""

from __future__ import annotations

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.experiments.gte.accumulator import Accumulator
from stiction_envs.experiments.gte.protocol import GTEProtocol, Run, load_gte_protocol


class Measures(Accumulator):
    """All measures of a run of I iterations with G goals, iteration by iteration.

    Root mean square, maximum, shaking and energy are over the motion: from the first goal's
    acceptance until the last goal was reached; the whole record where it never was.
    """

    def __init__(self, run: Run, protocol: GTEProtocol, motion: MotionLimits) -> None:
        """Measure a run; see `measure`."""
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
        self.duration = run.reached[:, -1]
        """(I,) when the last goal was reached, NaN if never [s]."""
        self.missed = ~(self.left <= [motion.position_tolerance, motion.rotation_tolerance]).all(-1)
        """(I, G) whether `settling` is beyond the generator's tolerance, so that only its patience
        ended the goal; roll, pitch and yaw errors are added as a vector. True where never
        reached."""

    @property
    def window_sum(self) -> Array:
        """(I, 6) of Table 4.11; NaN where the last goal was never accepted [m·samples,
        rad·samples]."""
        return self.window.sum

    @property
    def window_sum_of_mean(self) -> Array:
        """(6,) its other reading: sum of the absolute value of the iterations' mean error."""
        return np.abs(self.window.error.mean(axis=0)).sum(axis=0)

    @property
    def corner(self) -> Array:
        """(I, G − 1, 6) error when each new goal was accepted, in the last sample before the
        reference went to the measured pose; NaN where it never was. None for the first goal: there
        it is 0 by definition [m, rad]."""
        return self.settling[:, :-1]


def measure(
    run: Run, protocol: GTEProtocol | None = None, motion: MotionLimits | None = None
) -> Measures:
    """Return the measures of a run.

    Args:
        run: the run.
        protocol: whose window and tail; None for the default.
        motion: whose tolerances; None for the defaults.
    """
    return Measures(run, protocol or load_gte_protocol(), motion or MotionLimits())


def error_against_time(run: Run) -> tuple[Array, Array]:
    """Return mean and standard deviation of the error over iterations, (K, 6) each [m, rad].

    As in Figures 4.7, 4.8, F.1 and F.2. The deviation is 0 for a single iteration.
    """
    error = run.error
    return error.mean(axis=0), error.std(axis=0, ddof=min(1, len(error) - 1))


def sample_period(run: Run) -> float:
    """Return the time between two samples [s]; a run has at least two."""
    return float(run.time[1] - run.time[0])
