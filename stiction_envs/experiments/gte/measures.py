"""What a `Run` of the Generated Trajectory Experiment is judged by: errors, shaking, wear.

Errors are actual pose less reference, per axis x, y, z [m], roll, pitch, yaw [rad]. Roll, pitch and
yaw are those of the hand's frame: the Panda's flange starts with a yaw of −45°, in which errors
about the base's x and y would come out mixed; its hand starts with 0 (sources.md 1.1).

The reference moves at once to where the arm is whenever a goal is accepted (sources.md 6.2), so an
error counts from the last corner on.

Table 4.11 (thesis 4.2) sums "the error values for each coordinate" over "200 data points", "from 1
second before the last accepted new point to 1 second after". What that leaves open, and what is
taken here:

* *sum of absolute values, then mean over iterations* (`window_sums`, which has a spread), or
  absolute value of the mean over iterations, then the sum (`window_sum_of_mean`). They differ only
  where the iterations' signs differ: the first is never the smaller.
* *the last accepted point*: when the last goal was accepted, the last purple line of Figures 4.7
  and 4.8. The arm then turns at the last corner but one and moves on: both regimes that the text
  names, "arriving and moving from a point". The other reading, when the last goal was reached,
  is ``centre="reached"``.
* where the record begins less than 1 s before it: the arm rested with its reference where it was,
  so the missing samples count 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.errors import unknown
from stiction_envs.experiments.gte.accumulator import (
    Accumulator,
    ErrorWindow,
    distance_and_angle,
)
from stiction_envs.experiments.gte.protocol import GTEProtocol, Run, load_gte_protocol

Array = NDArray[np.float64]
CENTRES = ("accepted", "reached")
"""What the window of Table 4.11 may lie around: the last goal's acceptance, or its arrival."""


def error_against_time(run: Run) -> tuple[Array, Array]:
    """Return mean and standard deviation of the error over iterations, (K, 6) each [m, rad].

    As in Figures 4.7, 4.8, F.1 and F.2. The deviation is 0 for a single iteration.
    """
    error = run.error
    return error.mean(axis=0), error.std(axis=0, ddof=min(1, len(error) - 1))


def window(run: Run, *, half: float | None = None, centre: str = "accepted") -> Array:
    """Return the error in the window of Table 4.11, each iteration's around its own last point.

    Args:
        run: the run, I iterations.
        half: half the window [s]; None for the protocol's, 1 s.
        centre: one of :data:`CENTRES`.

    Returns:
        (I, W, 6) errors [m, rad], 200 samples with the defaults; NaN for an iteration whose last
        goal was never accepted (reached).

    Raises:
        StictionError: another centre.
    """
    if centre not in CENTRES:
        raise unknown("centre of the window", centre, CENTRES)
    last = (run.accepted if centre == "accepted" else run.reached)[:, -1]
    error, period = run.error, sample_period(run)
    half = load_gte_protocol().window if half is None else half
    out = ErrorWindow(len(error), round(half / period))
    out.add(error, np.zeros(len(error), dtype=np.int64), np.rint(last / period))
    # past the record's end, which the protocol's tail rules out, its last error is held
    out.close(error[:, -1], np.full(len(error), error.shape[1]))
    return out.error


def window_sums(run: Run, *, half: float | None = None, centre: str = "accepted") -> Array:
    """Return (I, 6) sums of the absolute error, as in Table 4.11 [m·samples, rad·samples].

    Arguments and errors as `window`.
    """
    return np.abs(window(run, half=half, centre=centre)).sum(axis=1)


def window_sum_of_mean(run: Run, *, half: float | None = None, centre: str = "accepted") -> Array:
    """Return (6,) sums of the absolute value of the iterations' mean error.

    The other reading of Table 4.11; arguments and errors as `window`.
    """
    return np.abs(window(run, half=half, centre=centre).mean(axis=0)).sum(axis=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measures:
    """All measures of a run of I iterations with G goals, iteration by iteration.

    Root mean square, maximum, shaking and energy are over the motion: from the first goal's
    acceptance until the last goal was reached; the whole record where it never was.
    """

    window_sum: Array
    """(I, 6) of Table 4.11; NaN where the last goal was never accepted [m·samples, rad·samples]."""
    window_sum_of_mean: Array
    """(6,) its other reading, see `window_sum_of_mean`."""
    total: Array
    """(I, 6) sum of the absolute error until the end of the tail [m·samples, rad·samples]."""
    mean: Array
    """(I, 6) mean absolute error [m, rad]."""
    rms: Array
    """(I, 6) root mean square [m, rad]."""
    maximum: Array
    """(I, 6) largest absolute error [m, rad]."""
    settling: Array
    """(I, G, 6) what is left of the error to each goal when the arm's time there is over: at the
    next acceptance (the same as `corner`), for the last goal at the end of the tail, `tail`
    seconds after it was reached; NaN where it never was [m, rad]."""
    missed: NDArray[np.bool_]
    """(I, G) whether `settling` is beyond the generator's tolerance, so that only its patience
    ended the goal; roll, pitch and yaw errors are added as a vector. True where never reached."""
    vibration: Array
    """(I, 6) root mean square above the protocol's `vibration_low`: of the position, then of turns
    about x, y, z times its `vibration_lever` [m]."""
    vibration_at_rest: Array
    """(I, 6) the same after the last goal was reached, until the record's end; NaN if it never
    was [m]."""
    dither_energy: Array
    """(I,) ∫ Σ|dither torque · motor speed| dt: what the dither moves back and forth [J]."""
    torque_rate: Array
    """(I,) largest change of torque on any joint, a measure of wear [N·m/s]."""
    duration: Array
    """(I,) when the last goal was reached, NaN if never [s]."""

    @property
    def corner(self) -> Array:
        """(I, G − 1, 6) error when each new goal was accepted, in the last sample before the
        reference went to the measured pose; NaN where it never was. None for the first goal: there
        it is 0 by definition [m, rad]."""
        return self.settling[:, :-1]

    @property
    def left(self) -> Array:
        """(I, G, 2) `settling` as distance [m] and angle [rad]: the error left at the goals."""
        return distance_and_angle(self.settling)

    @property
    def shaking(self) -> Array:
        """(I,) root mean square of the vibration, directions and turns together [m]."""
        return np.sqrt((self.vibration**2).sum(axis=1))

    @property
    def shaking_at_rest(self) -> Array:
        """(I,) the same at rest, after the last goal was reached [m]."""
        return np.sqrt((self.vibration_at_rest**2).sum(axis=1))


def measure(
    run: Run, protocol: GTEProtocol | None = None, motion: MotionLimits | None = None
) -> Measures:
    """Return the measures of a run.

    Args:
        run: the run.
        protocol: whose window; None for the default.
        motion: whose tolerances; None for the defaults.
    """
    motion = MotionLimits() if motion is None else motion
    protocol = load_gte_protocol() if protocol is None else protocol
    count, goals = run.accepted.shape
    sums = Accumulator(
        count, goals, rate=1.0 / sample_period(run), window=protocol.window, tail=protocol.tail
    )
    sums.start(np.arange(count), np.full(count, goals))
    sums.feed(
        run.error,
        np.ascontiguousarray(run.mean_square.transpose(0, 2, 1)),
        run.accepted,
        run.reached,
        run.dither_power,
    )
    sums.close()
    left = sums.left
    near = (left[..., 0] <= motion.position_tolerance) & (left[..., 1] <= motion.rotation_tolerance)
    return Measures(
        window_sum=sums.window.sum,
        window_sum_of_mean=np.abs(sums.window.error.mean(axis=0)).sum(axis=0),
        total=sums.total_error,
        mean=sums.mean,
        rms=sums.rms,
        maximum=sums.maximum,
        settling=sums.settling,
        missed=~near,  # nor is NaN
        vibration=sums.vibration,
        vibration_at_rest=sums.vibration_at_rest,
        dither_energy=sums.dither_energy,
        torque_rate=run.torque_rate.max(axis=1),
        duration=run.reached[:, -1],
    )


def sample_period(run: Run) -> float:
    """Return the time between two samples [s]; a run has at least two."""
    return float(run.time[1] - run.time[0])
