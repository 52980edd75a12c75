"""Names the causes of torque tables by one number: the log evidence of the model.

Every unknown has a Gaussian prior (`causes`), friction levels and offsets of each pose are off by a
little in every model, and errors are as large as makes the model most likely (`evidence`). The
search adds, removes or swaps one cause of one joint at a time on straight lines: from the nominal
model to a trial value, or through the value found. Values are then fitted to the curved predictions
(Gauss-Newton) and the evidence is Laplace's. A change stays if that evidence rises.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.judge.judgement import NotShown
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.predictors.named import HIDDEN, WIDTH
from stiction_envs.gap.tables.causes.base import Hypothesis
from stiction_envs.gap.tables.evidence import SIZES, JointEvidence
from stiction_envs.gap.tables.predictor import Around, Predictor, Values

Array = NDArray[np.float64]
LEVEL_SD, OFFSET_SD = 0.03, 0.007
"""Prior sizes of the errors of a pose's friction level, and of its offset over friction [-];
assumed: half the sum of two base torques of 1 % scatter each, and a level that varies more."""
TANGENT = 0.3
"""Step of x over its prior size for a tangent [-]; assumed: wider than the steps by which dither's
periods quantise breakaway torques."""
ROUNDS, STEPS, ENOUGH = 4, 12, 0.02
"""Of the fit: most states of the whole arm, most steps from each, and a step over the prior size
that ends it; assumed."""
MOST = 12
"""Most changes of a joint in a round of the search; assumed."""
SMALL = 4
"""Number of small errors of a joint: level and offset in both poses."""
GRID = 25
"""Number of values of a cause of all joints that are tried; assumed."""
RIVALS = 4
"""Number of likely rivals that are fitted; assumed."""
CLOSE = 8.0
"""Log evidence against a model below which it is simulated with the whole arm [nats]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The most likely values of a set of hypotheses, and how likely the set is."""

    values: dict[Hypothesis, float]
    around: Around
    """Predicts the readings near the values."""
    score: float
    """Log evidence and prior odds [nats]."""
    sd: dict[Hypothesis, float]
    """Standard deviations of the values."""
    size: dict[int, tuple[float, float]]
    """Scatter of a joint's readings, and their error that is common to a frequency and scale, over
    friction [-]."""
    common_nats: dict[int, float]
    """Log evidence for the common error against none [nats]."""


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight lines for hypotheses about one joint: small errors, its own, then all others."""

    names: list[Hypothesis | None]
    evidence: JointEvidence
    own: list[int]


class Judge:
    """All hypotheses about the tables, and the evidence of any set of them."""

    def __init__(
        self, predictor: Predictor, hypotheses: Iterable[Hypothesis], scatter: float
    ) -> None:
        """Take the hypotheses with their priors.

        Args:
            predictor: of the readings.
            hypotheses: what may be wrong.
            scatter: usual scatter of a reading over friction [-].
        """
        self.predictor, self.scatter = predictor, scatter
        self.readings, self.data = predictor.readings, predictor.data
        self.hypotheses = tuple(hypotheses)
        self.sd = {h: h.cause.size(self.data, h) for h in self.hypotheses}
        self.bounds = {h: predictor.bounds(h) for h in self.hypotheses}
        many = Counter(h.cause for h in self.hypotheses)
        self.odds = {h: h.cause.odds - math.log(many[h.cause]) - NAMED for h in self.hypotheses}
        # base torques have no common error: a common change of them is a change of level
        self.block = np.where(self.readings.base, -1, self.readings.block)
        self._known: dict[object, tuple[Array, Array, JointEvidence]] = {}

    # ---- columns ---------------------------------------------------------------------------------

    def _small(self, around: Around, joint: int, values: Values) -> list[Array]:
        """Return (rows,) effects of small errors of level and offset of each pose [-]."""
        rows = self.predictor.rows[joint]
        slope = around.level_slope(joint, values) / self.data.unit[rows]
        poses = [self.readings.pose[rows] == k for k in range(SMALL // 2)]
        return [
            *(LEVEL_SD * slope * pose for pose in poses),
            *(OFFSET_SD * self.readings.sign[rows] * pose for pose in poses),
        ]

    def _effect(
        self, around: Around, joint: int, values: Values, h: Hypothesis, x: float, to: float
    ) -> Array:
        """Return (rows,) mean effect of a prior size between two values, over friction [-]."""
        one, other = (around.of_joint(joint, {**values, h: v}) for v in (x, to))
        unit = self.data.unit[self.predictor.rows[joint]]
        return np.asarray((other - one) / (to - x) * self.sd[h] / unit)

    def _left(self, around: Around, joint: int, values: Values) -> Array:
        rows = self.predictor.rows[joint]
        left = self.readings.torque[rows] - around.of_joint(joint, values)
        return np.asarray(left / self.data.unit[rows])

    def _evidence(self, joint: int, columns: Sequence[Array], left: Array) -> JointEvidence:
        block = self.block[self.predictor.rows[joint]]
        return JointEvidence(np.stack(columns, axis=1), left, block, self.scatter)

    def residual(self, fit: Fit, values: Values | None = None) -> Array:
        """Return (N,) measured less predicted over friction [-]; None for the fit's values."""
        predicted = fit.around.predict(fit.values if values is None else values)
        return np.asarray((self.readings.torque - predicted) / self.data.unit)

    # ---- search ----------------------------------------------------------------------------------

    def search(self, say: Callable[[str], None]) -> Fit:
        """Return the best set of hypotheses.

        It starts from nothing, and from each cause of all joints, which one joint does not show.
        """
        nothing = self.fit({})
        best = self.improve(nothing, say)
        for h in self.hypotheses:
            if len(h.joints) > 1:
                x, gain = self.trial(h, nothing)
                if gain + self.odds[h] <= 0:
                    continue
                other = self.fit({h: x}, nothing.around, simulate=False)
                other = self.improve(other, say, simulate=False)
                if other.score > best.score - CLOSE:
                    other = self.improve(self.fit(other.values, other.around), say)
                    best = max(best, other, key=lambda f: f.score)
        return best

    def trial(self, h: Hypothesis, fit: Fit) -> tuple[float, float]:
        """Return the most likely x of a hypothesis beside others, and its log likelihood ratio."""
        low, high = self.bounds[h]
        score = dict.fromkeys([0.0, *np.linspace(low, high, GRID).tolist()], 0.0)
        for x in score:
            score[x] = -0.5 * (x / self.sd[h]) ** 2
            for j in h.joints:
                small = self._small(fit.around, j, fit.values)
                left = self._left(fit.around, j, {**fit.values, h: x})
                score[x] += self._evidence(j, small, left).best(range(SMALL))
        best = max(score, key=lambda x: score[x])
        return best, score[best] - score[0.0]

    def improve(self, start: Fit, say: Callable[[str], None], *, simulate: bool = True) -> Fit:
        """Change one hypothesis at a time, joint by joint, until no change raises the score.

        Args:
            start: the model to begin with.
            say: called with each change that is tried.
            simulate: whether changes are simulated with the whole arm.
        """
        best, again = start, True
        refused: set[frozenset[Hypothesis]] = set()
        while again:
            again = False
            for joint in self.readings.joints:
                for _ in range(MOST):
                    changed = self._changed(joint, best, refused)
                    if changed is None:
                        break
                    say(f"joint {joint}: {', '.join(sorted(h.name for h in changed)) or 'nothing'}")
                    new = self.fit(changed, best.around, simulate=False)
                    if simulate and new.score > best.score:
                        new = self.fit(new.values, best.around)
                    if new.score > best.score:
                        best, again = new, True
                    else:
                        refused.add(frozenset(changed))
            for h in [h for h in best.values if len(h.joints) > 1]:
                rest = {k: x for k, x in best.values.items() if k != h}
                new = self.fit(rest, best.around, simulate=simulate)
                if new.score > best.score:
                    best, again = new, True
        return best

    def _lines(self, joint: int, fit: Fit) -> _Lines:
        """Return straight lines for all hypotheses about one joint, beside those about others."""
        values, around = fit.values, fit.around
        own = [h for h in values if h.joints == (joint,)]
        names: list[Hypothesis | None] = [None] * SMALL
        columns = self._small(around, joint, values)
        left = self._left(around, joint, values)
        for h in own:
            to = values[h] or TANGENT * self.sd[h]
            columns.append(self._effect(around, joint, values, h, 0.0, to))
            left = left + columns[-1] * values[h] / self.sd[h]
        names += own
        for h in self.hypotheses:
            if h.joints != (joint,) or h in values:
                continue
            low, high = self.bounds[h]
            for x in (t * self.sd[h] for t in h.cause.trials):
                if low <= x <= high:
                    names.append(h)
                    columns.append(self._effect(around, joint, values, h, 0.0, x))
        evidence = self._evidence(joint, columns, left)
        return _Lines(names, evidence, list(range(SMALL, SMALL + len(own))))

    def _changed(
        self, joint: int, fit: Fit, refused: set[frozenset[Hypothesis]]
    ) -> dict[Hypothesis, float] | None:
        """Return values after the best change on a joint; None if none raises the score."""
        lines = self._lines(joint, fit)
        e, small = lines.evidence, list(range(SMALL))
        odds = [0.0 if h is None else self.odds[h] for h in lines.names]
        offers: list[tuple[float, list[int]]] = []
        for gone in (None, *lines.own):
            kept = [i for i in lines.own if i != gone]
            score, each = e.best(small + kept), e.with_each(small + kept)
            known = sum(odds[i] for i in kept)
            offers.append((score + known, kept))
            offers += [
                (float(each[i]) + known + odds[i], [*kept, i])
                for i in range(SMALL + len(lines.own), len(odds))
            ]
        now = offers[0][0]
        others = {h: x for h, x in fit.values.items() if h.joints != (joint,)}
        for score, some in sorted(offers, key=lambda x: -x[0]):
            if score <= now:
                break
            names = [h for i in some if (h := lines.names[i]) is not None]
            if frozenset([*others, *names]) not in refused:
                x = e.fit(small + some)[SMALL:] * [self.sd[h] for h in names]
                return others | {h: self._clipped(h, v) for h, v in zip(names, x, strict=True)}
        return None

    def rivals(self, fit: Fit, without: Fit, instead: Sequence[Hypothesis]) -> dict[str, Fit]:
        """Return models with another cause in place of some hypotheses, by its name.

        Args:
            fit: the model with the hypotheses.
            without: the model without them.
            instead: the hypotheses, of one cause and about the same joints.
        """
        joints = instead[0].joints
        best: dict[tuple[str, int], tuple[float, Hypothesis, float]] = {}
        for joint in joints:
            lines = self._lines(joint, without)
            own = list(range(SMALL + len(lines.own)))
            each = lines.evidence.with_each(own) - lines.evidence.best(own)
            for i in range(len(own), len(lines.names)):
                if (h := lines.names[i]) is None or h.name == instead[0].name:
                    continue
                x = self.sd[h] * float(lines.evidence.fit([*own, i])[-1])
                offer = float(each[i]) + self.odds[h], h, self._clipped(h, x)
                best[h.name, joint] = max(best.get((h.name, joint), offer), offer, key=_first)
        offers: dict[str, tuple[float, dict[Hypothesis, float]]] = {}
        for (name, _), (gain, h, x) in best.items():
            total, some = offers.get(name, (0.0, {}))
            if len(joints) == 1 or gain > 0:
                offers[name] = total + gain, {**some, h: x}
        likely = sorted(offers, key=lambda n: -offers[n][0])[:RIVALS]
        values = {name: offers[name][1] for name in likely if offers[name][1]}
        for h in self.hypotheses:
            if len(h.joints) > 1 and h.name != instead[0].name and h not in without.values:
                values[h.name] = {h: self.trial(h, without)[0]}
        out = {
            name: self.fit({**without.values, **x}, without.around, simulate=False)
            for name, x in values.items()
        }
        close = fit.score - CLOSE
        return {
            name: self.fit(f.values, f.around) if f.score > close else f for name, f in out.items()
        }

    def not_shown(self, fit: Fit) -> tuple[NotShown, ...]:
        """Return the causes of whole joints whose posterior is about as wide as their prior."""
        out: dict[tuple[str, int], NotShown] = {}
        for joint in self.readings.joints:
            lines = self._lines(joint, fit)
            mean, sd = lines.evidence.shown(range(SMALL + len(lines.own)))
            whole = set(self.predictor.rows[joint].tolist())
            for i, h in enumerate(lines.names):
                if h is None or i in lines.own or sd[i] < HIDDEN or set(h.rows) != whole:
                    continue
                ends = (
                    h.cause.values(self.data, h, self._clipped(h, self.sd[h] * float(x)))
                    for x in (mean[i] - WIDTH * sd[i], mean[i] + WIDTH * sd[i])
                )
                (key, a), (_, b) = (next(iter(x.items())) for x in ends)
                found = NotShown(name=h.name, joints=h.joints, parameters={key: (a, b)})
                out.setdefault((h.name, joint), found)
        return tuple(out.values())

    def _clipped(self, h: Hypothesis, x: float) -> float:
        return float(np.clip(x, *self.bounds[h]))

    # ---- fit -------------------------------------------------------------------------------------

    def fit(self, values: Values, around: Around | None = None, *, simulate: bool = True) -> Fit:
        """Return the most likely values of hypotheses, starting from some.

        Args:
            values: from which it starts.
            around: from which it predicts at first; None for near the values.
            simulate: whether the whole arm is simulated again where the values have moved.
        """
        x = dict(values)
        around = around or self.predictor.around(x)
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                to = self._laplace(around, x).values
                # a straight line holds for about one prior size
                step = {h: float(np.clip(to[h] - v, -self.sd[h], self.sd[h])) for h, v in x.items()}
                x = {h: self._clipped(h, v + step[h]) for h, v in x.items()}
                if all(abs(d) < ENOUGH * self.sd[h] for h, d in step.items()):
                    break
            new = self.predictor.around(x, around.states) if simulate else around
            if new.states == around.states:
                break
            around = new
        return self._laplace(around, x)

    def _tangents(
        self, around: Around, joint: int, values: Values
    ) -> tuple[Array, Array, JointEvidence]:
        """Return columns of a joint, its residual with all values 0, and their evidence."""
        own = {h: x for h, x in values.items() if joint in h.joints}
        key = joint, around.states[joint], tuple(own.items())
        if key not in self._known:
            columns, left = self._small(around, joint, own), self._left(around, joint, own)
            for h, x in own.items():
                step = TANGENT * self.sd[h]
                columns.append(self._effect(around, joint, own, h, x - step, x + step))
                left = left + columns[-1] * x / self.sd[h]
            evidence = self._evidence(joint, columns, left)
            self._known[key] = np.stack(columns, axis=1), left, evidence
        return self._known[key]

    def _laplace(self, around: Around, values: Values) -> Fit:
        """Return the fit on the tangents at some values."""
        sums, volume, size, common_nats = {}, 0.0, {}, {}
        for j in self.readings.joints:
            columns, _, e = self._tangents(around, j, values)
            of = e.of(range(columns.shape[1]))
            k = int(of.argmax())
            sums[j], size[j], volume = e.sums[k], SIZES[k], volume + float(e.volume[k])
            none = max(x for x, (_, c) in zip(of.tolist(), SIZES, strict=True) if not c)
            common_nats[j] = float(of[k]) - none
        x, cov, evidence = self._solved(sums, values)
        # beyond a bound it is the evidence of the bound
        beyond = np.array([self._clipped(h, v) - v for h, v in x.items()])
        evidence -= 0.5 * float(beyond @ np.linalg.solve(cov, beyond))
        return Fit(
            values={h: self._clipped(h, v) for h, v in x.items()},
            around=around,
            score=volume + evidence + sum(self.odds[h] for h in values),
            sd=dict(zip(values, np.sqrt(np.diag(cov)).tolist(), strict=True)),
            size={j: (self.scatter * s, self.scatter * c) for j, (s, c) in size.items()},
            common_nats=common_nats,
        )

    def _solved(
        self, sums: Mapping[int, Array], values: Values
    ) -> tuple[dict[Hypothesis, float], Array, float]:
        """Return values, their covariance, and log evidence of all joints' normal equations."""
        hypotheses, joints = list(values), self.readings.joints
        n = SMALL * len(joints) + len(hypotheses)
        m, b, misfit = np.eye(n), np.zeros(n), 0.0
        for k, j in enumerate(joints):
            own = [i for i, h in enumerate(hypotheses) if j in h.joints]
            at = np.array(
                [*range(SMALL * k, SMALL * (k + 1)), *(SMALL * len(joints) + i for i in own)]
            )
            m[np.ix_(at, at)] += sums[j][:-1, :-1]
            b[at] += sums[j][:-1, -1]
            misfit += float(sums[j][-1, -1])
        found, cov = np.linalg.solve(m, b), np.linalg.inv(m)
        evidence = -0.5 * (misfit - float(b @ found) + float(np.linalg.slogdet(m)[1]))
        first = SMALL * len(joints)
        sd = np.array([self.sd[h] for h in hypotheses])
        x = dict(zip(hypotheses, (found[first:] * sd).tolist(), strict=True))
        return x, np.asarray(cov[first:, first:] * np.outer(sd, sd)), evidence

    def left_out(self, fit: Fit) -> Array:
        """Return `residual` (N,) of each block, predicted with values fitted to the others [-]."""
        out = np.empty(len(self.readings.all))
        for block in range(len(self.readings.blocks)):
            sums = {}
            for j, rows in self.predictor.rows.items():
                columns, left, _ = self._tangents(fit.around, j, fit.values)
                used = self.readings.block[rows] != block
                s, c = fit.size[j]
                size = [(s / self.scatter, c / self.scatter)]
                e = JointEvidence(
                    columns[used], left[used], self.block[rows][used], self.scatter, size
                )
                sums[j] = e.sums[0]
            x, _, _ = self._solved(sums, fit.values)
            some = self.readings.block == block
            clipped = {h: self._clipped(h, v) for h, v in x.items()}
            out[some] = self.residual(fit, clipped)[some]
        return out


def _first(offer: tuple[float, Hypothesis, float]) -> float:
    return offer[0]
