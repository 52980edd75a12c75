"""Judge a smooth torque over the angle by ranges of the angle that were left out.

All blocks of time contain the same angles. A curve with enough coefficients predicts all of them,
but is arbitrary where the joint has not been. Left-out ranges of the angle show this.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.linear.grams import Gram, t_statistic
from stiction_envs.gap.linear.joint_grams import JointGrams
from stiction_envs.gap.linear.model_columns import ModelColumns
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data

Array = NDArray[np.float64]


def equal_travel(data: Data, joint: int, count: int) -> NDArray[np.int64]:
    """Return (T,) number of the range of a joint's angle, −1 where a row is in no block.

    The joint travels equally far in each range; poses at rest are divided equally among them.
    """
    rows = data.block >= 0
    step = np.abs(data.dq[:, joint]) * rows
    if not step.any():
        step = rows.astype(float)
    order = np.argsort(data.q[:, joint], kind="stable")
    gone = np.cumsum(step[order])
    out = np.empty(len(order), dtype=np.int64)
    out[order] = np.minimum((count * gone / gone[-1]).astype(np.int64), count - 1)
    return np.where(rows, out, -1)


class AngleRanges:
    """A joint of a model, fitted with each range of its angle left out in turn.

    Terms that act on other joints too (a payload, a tilt, a delay) keep their fit to all ranges.
    The joint's other terms are fitted anew with each range left out.
    """

    def __init__(
        self, library: RegressorLibrary, terms: Sequence[Candidate], term: Candidate
    ) -> None:
        """Prepare to judge a term of one joint in a model ``terms``."""
        data, j = library.data, term.joint
        self._library, self._term = library, term
        self._settings = data.settings.angle_ranges
        self._ranges = equal_travel(data, j, self._settings.ranges)
        self._own = [
            t for t in terms if t != term and not t.small and library.affected_joints(t) == [j]
        ]
        self._target = library.residual[:, j].copy()
        for other, mine in zip(terms, library.fitted(terms), strict=True):
            if other != term and other not in self._own and j in library.affected_joints(other):
                self._target -= library.columns(other, j) @ mine

    def with_and_without(self, term: Candidate) -> tuple[Array, Array, float]:
        """Return (R,) squared errors without a term of the joint, with it, and its slope.

        Errors are in units of noise variance. The slope compares the observed torque with what the
        term predicts beyond the others, in standard errors between ranges.
        """
        library, j, own = self._library, term.joint, [*self._own, term]
        columns = [library.columns(t, j) for t in own]
        bounds = [library.bounds(t) for t in own]
        low, high = (tuple(np.concatenate([b[side] for b in bounds]).tolist()) for side in (0, 1))
        size, rest = len(low), len(low) - columns[-1].shape[1]
        weight = library.weight[:, j] / library.data.noise[j] ** 2
        x, count = np.concatenate(columns, axis=1), self._settings.ranges
        grams = JointGrams([Gram.of(x, self._target, self._ranges, weight, count)])

        def first(columns: int) -> ModelColumns:
            every = tuple(range(columns))
            return ModelColumns((every,), (every,), low[:columns], high[:columns])

        model, without = first(size), first(rest)
        pe, pp = grams.cross_predicted(model, without, np.arange(size) >= rest)
        slope = float(t_statistic(pe[0], pp[0]))
        return grams.held_out(without)[0], grams.held_out(model)[0], slope

    def predicts_left_out(self, term: Candidate | None = None) -> bool:
        """Whether the term predicts left-out ranges, and no simpler term does so as well.

        A simpler cause, to which this one gives way, must predict them clearly less well. The same
        cause with fewer columns must predict less well too, if ranges confirm it.
        """
        term = term or self._term
        before, after, came = self.with_and_without(term)
        limit = float(student.ppf(1 - self._settings.chance, max(len(before) - 1, 1)))
        if after.sum() >= before.sum() or came <= limit:
            return False
        simpler = [
            t
            for t in self._library.candidates
            if t not in self._own and simpler_by_angle(self._library, term, t)
        ]
        for other in simpler:
            less = self.with_and_without(other)[1]
            if other.cause != term.cause:
                if less.sum() <= after.sum() or _worse(less, after) <= limit:
                    return False
            elif _worse(less, after) <= 0 and self.predicts_left_out(other):
                return False
        return True


def simpler_by_angle(library: RegressorLibrary, term: Candidate, other: Candidate) -> bool:
    """Whether left-out ranges of angle choose between a term and a simpler one of its joint."""
    cause = library.causes[term.cause]
    if not cause.simpler_over_angle or other.joint != term.joint:
        return False
    fewer = other.cause == term.cause and other.shape < term.shape
    return fewer or other.cause in cause.simpler_over_angle


def _worse(one: Array, other: Array) -> float:
    """Return by how many standard errors between ranges errors (R,) exceed others, as a factor.

    It is a factor because the outermost ranges, beyond what is fitted, have most of the error.
    """
    more = np.log(np.maximum(one, 1e-300) / np.maximum(other, 1e-300))
    error = float(more.std(ddof=1) / np.sqrt(len(more))) if len(more) > 1 else np.inf
    return float(more.mean()) / max(error, 1e-12)


def holds_over_angle(
    library: RegressorLibrary, terms: Sequence[Candidate], term: Candidate
) -> bool:
    """Whether a term predicts its joint's torque at angles that its fit has not seen."""
    return AngleRanges(library, terms, term).predicts_left_out()
