"""Torque along a measured motion: the columns of all causes, and what no model has.

    τ_j(t) = nominal + Σ small errors + Σ named causes + e_j(t)

e_j is not the sensor's noise alone. Its variance is s_j (σ_j² + (δ_j τ_j)²) + (T_j dτ_j/dt)²: σ_j
is the noise floor, δ_j a share of the joint's usual torque that no model has, T_j the time by which
clocks, filters and lags shift torques, and s_j ≥ 1 what the model leaves beyond. Rows within
`APART` count as one. Errors of the model last (`lasting`) and come back (`repeats`): r_j
observations share one.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stiction_envs.arrays import Array, Bools, Index, rms
from stiction_envs.gap.causes import Cause, Shape
from stiction_envs.gap.causes.base import (
    ALL_LINKS,
    ALL_OF_ONE,
    DRY,
    FRICTION,
    PLAIN,
    filtered_columns,
    limits,
)
from stiction_envs.gap.judge.problem import ARM, LINKS, Channel, Problem, Term
from stiction_envs.gap.judge.search import Model
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.measured.motion_thresholds import REST_SPEED

APART = 0.2
"""Time between independent observations [s]; assumed: about a period of usual cutoffs. With 0.15 s
some public logs get false names, with 0.25 s errors on others are larger."""
PARTS = (1.0, 0.1)
"""Sizes of priors that are tried, over the usual size of the cause [-]; assumed: a good log shows
small errors, too."""
RESTING = 20.0
"""Variance of rows in which a joint rests below its steady friction, over that in motion [-];
assumed: such a log hardly shows how far the joint sprang back, so that its torque is known to about
0.2 of its friction, five times the noise of a good log."""
STEADY = 0.9
"""Part of the steady level above which friction counts as steady [-]; assumed."""
CELL = 0.1
"""Angle within which an arm is in the same place again [rad]; assumed."""
LEAST_ALIKE, MOST_LASTING = 0.05, 40
"""Autocorrelation of an error that has ended, and most observations of one error [-]; assumed."""
TINY = 1e-300
"""Keeps a joint without any torque from a division by zero."""
MOSTLY = 0.8
"""Part of rows at rest from which on there are no others to go by [-]; assumed."""
SHARES = (0.001, 0.003, 0.01, 0.03)
"""δ that are tried [-]; assumed."""
DELAYS = (0.002, 0.003, 0.01)
"""T that are tried [s]; assumed: from two cycles of a robot to what filters and lags may leave."""
SIZED = 0.01
"""Relative error of s [-]; assumed: far below its doubt."""
SCALES = (0.03, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Sizes of the small errors over their tolerance that are tried [-]; assumed."""
FOLDS = 4
"""Parts of the logs that are held out in turn [-]."""


class TorquePredictor:
    """The equations of joint logs: candidates, their columns and sums."""

    problem: Problem
    expects: Array
    """(n, 2) δ [-] and T/√s [s] of each joint."""
    repeats: Array
    """(n,) r: number of observations of each joint that share an error of the model [-]."""

    def __init__(
        self,
        data: Data,
        causes: Sequence[Cause],
        found: Mapping[Term, Array] | None = None,
    ) -> None:
        """Compute all columns; nonlinear causes choose the parameters to try.

        Args:
            data: the logs.
            causes: hypotheses, those with random effects among them.
            found: torque (T, n) of each term of an earlier model, in whose residual nonlinear
                causes look for their parameters; None for none.
        """
        self.data, self.causes = data, {c.name: c for c in causes}
        self.candidates: list[Term] = []
        self.volume = 0.0
        self.links_known = data.recording.link_factor is not None
        self.fold = np.where(data.block >= 0, data.block % FOLDS, -1)
        channels = [Channel(data.residual[:, j], self.fold, FOLDS) for j in range(data.n)]
        self.rows = max(APART / data.dt, 1.0) if np.isfinite(data.dt) else 1.0
        self.repeats = np.ones(data.n)
        self.problem = Problem(channels, np.full(data.n, self.rows))
        self._slope = data.rate(data.tau)
        self._resting = resting(data)
        self._usual = rms(data.nominal)
        self.expect(self.problem, np.tile((SHARES[1], DELAYS[1]), (data.n, 1)))
        self._add_candidates(found)

    # ---- what no model has -------------------------------------------------------------------

    def _variance(self, joint: int, share: float, delay: float) -> Array:
        """Return (T,) variance of a joint's rows over s, for δ [-] and T/√s [s]."""
        out = self.data.noise[joint] ** 2 + (share * self._usual[joint]) ** 2
        out = out + (delay * self._slope[:, joint]) ** 2
        out[self._resting[:, joint]] *= RESTING
        return out

    def expect(self, problem: Problem, expects: Array) -> None:
        """Take δ and T/√s (n, 2) of the joints: rows weigh one over their variance, over s."""
        self.expects = expects
        each = [self._variance(j, *x) for j, x in enumerate(expects)]
        problem.reweigh(np.stack([1 / x for x in each], axis=1))
        kept = self.fold >= 0
        self.volume = -0.5 * float(np.sum([np.log(x[kept]).sum() for x in each])) / self.rows

    def refresh(self, problem: Problem, terms: Sequence[Term], *, resizes: bool = True) -> float:
        """Set noise, and with ``resizes`` sizes of the small errors, by what a model leaves.

        Return its evidence.
        """
        count = problem.counts() / self.rows
        model, r = problem.model(terms), self.repeats
        size = problem.errors(model, problem.fit(model)) / self.rows / np.maximum(count, 1.0)
        size = np.maximum(size, 1.0)
        problem.given(self.rows * (1 + r * (size - 1)))
        for k in range(2):
            if resizes and not (k == 0 and self.links_known):
                self._resize(problem, terms, k)
        # errors within a place are noise, whatever the model leaves beyond
        spread = np.log1p(r * (size - 1)) / r + 1 - size / (1 + r * (size - 1))
        return problem.score(terms) - 0.5 * float(count @ spread) + self.volume

    def _resize(self, problem: Problem, terms: Sequence[Term], kind: int) -> None:
        """Give small errors of a kind the size of the most evidence, from the present one on."""

        def score(at: int) -> float:
            sizes = list(problem.scales)
            sizes[kind] = SCALES[at]
            problem.given(scales=(sizes[0], sizes[1]))
            return problem.score(terms)

        at = SCALES.index(problem.scales[kind])
        best = score(at)
        for step in (1, -1):
            while 0 <= at + step < len(SCALES) and (more := score(at + step)) > best:
                at, best = at + step, more
        score(at)

    def expected(self, model: Model) -> Array:
        """Return (n, 2) δ and T/√s of each joint with which what a model leaves is most likely.

        As if errors of the model did not last: only the variance's shape over the rows matters.
        """
        terms, kept = self.problem.model(model.terms), self.fold >= 0
        left, out = self.left(terms), np.empty((self.data.n, 2))
        for j in range(self.data.n):
            square, best = np.square(left[kept, j]), -np.inf
            for share, delay in product(SHARES, DELAYS):
                steady = self._variance(j, share, 0.0)[kept]
                late = np.square(delay * self._slope[kept, j])

                def beyond(
                    size: float, square: Array = square, steady: Array = steady, late: Array = late
                ) -> float:
                    return float((square / (size * steady + late)).mean()) - 1

                most = float((square / steady).mean())
                size = brentq(beyond, 1.0, 2 * most, rtol=SIZED) if beyond(1.0) > 0 else 1.0
                likely = -float(np.log(size * steady + late).mean()) - beyond(size)
                if likely > best:
                    best, out[j] = likely, (share, delay / np.sqrt(size))
        return out

    def lasting(self, model: Model) -> Array:
        """Return (n,) r: how many observations share an error of a model, in time and place."""
        terms, kept = self.problem.model(model.terms), np.flatnonzero(self.fold >= 0)
        left, often = self.left(terms), repeats(self.data, self.rows)
        out = np.empty(self.data.n)
        for j, channel in enumerate(self.problem.channels):
            error = left[:, j] * np.sqrt(channel.weight)
            torque, block = self.data.nominal[kept, j], self.data.block[kept]
            out[j] = often * lasting(error[kept], torque, block, round(self.rows))
        return out

    # ---- candidates --------------------------------------------------------------------------

    def _add_candidates(self, found: Mapping[Term, Array] | None) -> None:
        """Add small errors and all hypotheses."""
        data = self.data
        for cause in self.causes.values():
            if cause.adds_to == ALL_LINKS:
                (size,) = self.rows_of([term := Term(cause.name, ARM, LINKS, small=True)])
                sd = np.full(len(size[0]), cause.prior(data, ARM, ()).usual)
                free = np.full(len(sd), np.inf)
                self.problem.add(term, size, sd, (-free, free), 0.0)
        named = [c for c in self.causes.values() if c.adds_to != ALL_LINKS]
        offered = [(c, j) for c in named for j in c.joints(data)]
        self._hypotheses = len(offered)
        for cause, joint in offered:
            if cause.is_linear:
                left = data.residual[:, max(joint, 0)]
                self.offer(cause, joint, cause.shapes(data, max(joint, 0), left))
        if found is None:
            left = self._left_by_friction()
        else:
            left = data.residual - np.sum(list(found.values()), axis=0)
        for cause, joint in offered:
            if not cause.is_linear:
                j = max(joint, 0)
                mine = left[:, j]
                for term, torque in (found or {}).items():
                    if (term.cause, term.joint) == (cause.name, joint):
                        mine = mine + torque[:, j]
                self.offer(cause, joint, cause.shapes(data, j, mine))

    def offer(self, cause: Cause, joint: int, shapes: Sequence[Shape]) -> None:
        """Add a cause on a joint with several nonlinear parameters, unless they are there."""
        every = [Term(cause.name, joint, tuple(float(x) for x in shape)) for shape in shapes]
        new = [t for t in dict.fromkeys(every) if t not in self.problem.numbers]
        for term, columns in zip(new, self.rows_of(new), strict=True):
            self.candidates += self._add(self.problem, term, columns, len(shapes))

    def add(self, problem: Problem, term: Term) -> None:
        """Add a term to a problem."""
        (columns,) = self.rows_of([term])
        self._add(problem, term, columns, 1)

    def _add(
        self, problem: Problem, term: Term, columns: Mapping[int, NDArray[np.float32]], count: int
    ) -> list[Term]:
        """Add a term, one of ``count`` alike, to a problem with all sizes of its prior.

        Return the terms that were added; none where these data do not show the cause.
        """
        data, cause = self.data, self.causes[term.cause]
        if not any(np.abs(x).max(initial=0.0) > 0 for x in columns.values()):
            return []
        k = len(next(iter(columns.values())))
        prior = cause.prior(data, term.joint, term.shape)
        low, high = limits(cause, prior, data)
        odds = prior.odds + (0.0 if prior.everywhere else float(np.log(self._hypotheses)))
        odds += 0.5 * float(np.log(max(count, 1))) + float(np.log(len(PARTS)))
        size = prior.size[:k]
        each = [term._replace(part=x) for x in (PARTS if cause.is_linear else PARTS[:1])]
        problem.add(each[0], columns, size, (low[:k], high[:k]), odds)
        for other in each[1:]:
            problem.share(other, each[0], np.maximum(other.part, prior.least) * size)
        usual, small = prior.usual, Term(term.cause, term.joint, (), True)
        if usual and small not in problem.numbers:
            problem.share(small, each[0], np.full(k, usual))
        if cause.adds_to in FRICTION and not data.has_friction:
            problem.share(small._replace(part=PARTS[-1]), each[0], PARTS[-1] * size)
        return each

    def whole(self, problem: Problem, named: Sequence[Term]) -> list[Term]:
        """Return the terms of a finished model: every joint has friction, named or not."""
        have = {t[:2] for t in named}
        aside = (t for t in problem.numbers if t.aside and t[:2] not in have)
        small = problem.model(named)[: -len(named) or None]
        return [*small, *aside, *named]

    def _left_by_friction(self) -> Array:
        """Return (T, n) what the joints' plain friction, offset and inertia leave [N·m]."""
        plain = [
            t
            for t in self.candidates
            if self.causes[t.cause].adds_to in PLAIN and t.part == PARTS[0] and t.joint != ARM
        ]
        return self.left(self.problem.model(plain))

    def affected_joints(self, term: Term) -> list[int]:
        """Return the joints (from 0) whose torques a term acts on."""
        if term.joint == ARM or self.causes[term.cause].acts_on == ALL_OF_ONE:
            return list(range(self.data.n))
        return [term.joint]

    def rows_of(self, terms: Sequence[Term]) -> Iterator[dict[int, NDArray[np.float32]]]:
        """Yield the (k, T) columns of each term of a cause on a joint, on all joints it acts on."""
        if not terms:
            return
        cause, joint = self.causes[terms[0].cause], terms[0].joint
        for x in filtered_columns(cause, self.data, joint, [t.shape for t in terms]):
            each = {joint: x} if x.ndim == 2 else {j: x[:, j] for j in range(self.data.n)}
            yield {j: np.ascontiguousarray(x.T, dtype=np.float32) for j, x in each.items()}

    def needs(self, name: str) -> tuple[str, ...]:
        """Return the causes that a cause needs: none if the nominal model has friction."""
        return () if self.data.has_friction else self.causes[name].needs

    def possible(
        self, problem: Problem, terms: Sequence[Term], asked: Sequence[Term]
    ) -> list[bool]:
        """Return whether each asked term's value in a model is one that its cause can have."""
        model = problem.model(terms)
        parts = dict(zip(model, problem.split(model, problem.fit(model)), strict=True))
        level = dict(enumerate(self.data.friction.level.tolist()))
        for t, c in parts.items():
            if self.causes[t.cause].adds_to == DRY:
                level[t.joint] = level.get(t.joint, 0.0) + float(c[0])
        data, causes = self.data, self.causes
        return [
            causes[t.cause].possible(data, t.joint, parts[t], t.shape, level.get(t.joint, 0.0))
            for t in asked
        ]

    # ---- torques -----------------------------------------------------------------------------

    def columns(self, term: Term, joint: int) -> Array:
        """Return the (T, k) columns of a term on a joint."""
        columns = self.problem.channels[joint].columns(self.problem.numbers[term])
        return columns.T.astype(np.float64)

    def torque(self, terms: Sequence[Term], c: Array) -> Array:
        """Return (T, n) torque of a model with coefficients (P,) [N·m]."""
        out = np.zeros_like(self.data.q)
        for term, mine in zip(terms, self.problem.split(terms, c), strict=True):
            for j in self.affected_joints(term):
                out[:, j] += self.columns(term, j) @ mine
        return out

    def torques(self, terms: Sequence[Term], c: Array) -> dict[Term, Array]:
        """Return the torque (T, n) of each term of a model with coefficients (P,) [N·m]."""
        parts = self.problem.split(terms, c)
        return {t: self.torque([t], mine) for t, mine in zip(terms, parts, strict=True)}

    def left(self, terms: Sequence[Term]) -> Array:
        """Return (T, n) the residual torque that the best fit of a model leaves [N·m]."""
        return self.data.residual - self.torque(terms, self.problem.fit(terms))

    def information(self) -> Array:
        """Return (n,) number of independent observations over their variance [1/(N·m)²]."""
        weight = np.array([float(x.weight[self.fold >= 0].sum()) for x in self.problem.channels])
        return weight / self.problem.inflation


def repeats(data: Data, rows: float) -> float:
    """Return one over the part of the time at which the arm is where it was not before [-].

    It is where it was if its joints are in the same place and move the same way. ``rows`` are those
    of one independent observation.
    """
    kept = np.flatnonzero(data.block >= 0)
    way = np.where(np.abs(data.dq[kept]) < REST_SPEED, 0, np.sign(data.dq[kept]))
    place = np.concatenate([np.round(data.q[kept] / CELL), way], axis=1).astype(np.int16)
    _, first, number = np.unique(place, axis=0, return_index=True, return_inverse=True)
    new = kept - kept[first[number.ravel()]] < rows
    return 1 / float(new.mean()) if len(kept) else 1.0


def lasting(error: Array, signal: Array, block: Index, rows: int) -> float:
    """Return how many observations of an error count as one where a signal is fitted [-].

    The variance of the coefficient of a signal is that of independent errors times the sum of the
    products of both autocorrelations.

    Args:
        error: (T,) over its standard deviation.
        signal: (T,).
        block: (T,) number of the block of each row.
        rows: number of rows of one observation.
    """
    total, x = 1.0, signal - signal.mean()
    size = max(float(np.mean(np.square(error)) * np.mean(np.square(x))), TINY)
    for lag in range(rows, MOST_LASTING * rows + 1, rows):
        same = block[lag:] == block[:-lag]
        if not same.any():
            break
        alike = float(np.prod([(y[lag:] * y[:-lag])[same].mean() for y in (error, x)])) / size
        if alike < LEAST_ALIKE:
            break
        total += 2 * alike
    return total


def resting(data: Data) -> Bools:
    """Return (T, n) where a joint rests below its steady friction, but not most of the time."""
    if not np.isfinite(data.dt):
        return np.zeros(data.q.shape, dtype=bool)
    recording = data.recording
    speed = np.abs(recording.path_rate(recording.reversal_path))[recording.path_rows]
    steady = np.abs(data.directions)[recording.path_rows] >= STEADY
    off = (speed < REST_SPEED) & ~steady
    return np.asarray(off & (off.mean(axis=0) < MOSTLY))
