"""Errors of the whole arm: held out, of the nominal simulation, and on logs that took no part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo import contact
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import segments
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
FOLD_SECONDS = 10.0
"""Length of the blocks of time that are held out in turn [s]; assumed."""
WORSE = 1.1
"""Least error of the extended model over the nominal one on other logs that is worse [-];
assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoCheck:
    """The model on logs that took no part."""

    nominal_rms: Array
    """(n,) [rad]."""
    extended_rms: Array
    """(n,) [rad]."""
    worse_joints: tuple[int, ...]

    @property
    def verdict(self) -> str:
        """``holds`` or ``does not hold``."""
        return "does not hold" if self.worse_joints else "holds"

    def to_json(self) -> dict[str, object]:
        """Return the entry ``check``."""
        return {
            "nominal_rms_rad": self.nominal_rms.tolist(),
            "extended_rms_rad": self.extended_rms.tolist(),
            "verdict": self.verdict,
            "worse_joints": list(self.worse_joints),
            "not_transferring": [],
        }


def folds(motion: JointMotion) -> list[NDArray[np.bool_]]:
    """Return two halves of the rows, in alternating blocks of time."""
    segment = np.repeat(np.arange(len(motion.bounds) - 1), np.diff(motion.bounds))
    since = motion.t - motion.t[motion.bounds[segment]]
    even = (since // FOLD_SECONDS + segment) % 2 == 0
    return [even, ~even]


def rows(logs: Sequence[ServoLog], angles: Sequence[Array]) -> Array:
    """Return the rows of all segments, as motions have them."""
    return np.concatenate([angles[k][s] for k, s in segments(logs)])


def _parts(
    logs: Sequence[ServoLog], some: NDArray[np.bool_]
) -> Iterator[tuple[int, slice, NDArray[np.bool_]]]:
    """Yield each segment with its part of (T,) rows as motions have them."""
    begin = 0
    for k, s in segments(logs):
        end = begin + s.stop - s.start
        yield k, s, some[begin:end]
        begin = end


def held_out(
    logs: Sequence[ServoLog], of_first: NDArray[np.bool_], halves: Sequence[Sequence[Array]]
) -> list[Array]:
    """Return per log the angles of the model that was fitted to the other half of the time."""
    out = [angle.copy() for angle in halves[0]]
    for k, s, first in _parts(logs, of_first):
        out[k][s][first] = halves[1][k][s][first]
    return out


def nominal_angles(
    arm: Arm, logs: Sequence[ServoLog], servo: Servo, nominal: Array, load: Array
) -> list[Array]:
    """Return per log the angles of the simulation that is judged [rad]."""
    if servo.perfect:
        return [log.q_cmd.copy() for log in logs]
    return simulate_arm(arm, logs, nominal, load, threads=1)


def rms(error: Array, rows: NDArray[np.bool_]) -> Array:
    """Return (n,) root mean square of (T, n) errors over some rows [rad]."""
    return np.asarray(np.sqrt(np.nanmean(error[rows] ** 2, axis=0)))


def touching(logs: Sequence[ServoLog], touched: NDArray[np.bool_]) -> list[list[list[float]]]:
    """Return per log the stretches [s] of the rows that were left out."""
    out: list[list[list[float]]] = [[] for _ in logs]
    for k, s, some in _parts(logs, touched):
        out[k] += contact.stretches(logs[k].t[s], some)
    return out


def check_model(
    logs: Sequence[ServoLog], plain: Sequence[Array], model: Sequence[Array], fitted_rms: Array
) -> ServoCheck:
    """Return the errors of both models on logs that took no part.

    Args:
        logs: of the arm.
        plain: per log, (T, n) angles of the nominal simulation [rad].
        model: per log, (T, n) angles of the extended model [rad].
        fitted_rms: (n,) held-out error where the model was fitted [rad].
    """
    q = rows(logs, [log.q for log in logs])
    all_rows = np.ones(len(q), dtype=bool)
    before = rms(q - rows(logs, plain), all_rows)
    after = rms(q - rows(logs, model), all_rows)
    worse = np.flatnonzero((after > WORSE * before) & (after > fitted_rms))
    return ServoCheck(
        nominal_rms=before, extended_rms=after, worse_joints=tuple(int(j) + 1 for j in worse)
    )
