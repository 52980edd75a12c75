"""Hypotheses about an arm, one unknown each, fitted to torque tables and judged on held-out blocks.

A block is all readings of one dither frequency and scale, or all base torques. Single readings are
not held out, since their neighbours predict them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from stiction_envs.gap.tables.causes.base import Hypothesis, TableCause
from stiction_envs.gap.tables.lone_joint import Bench, LoneJoint
from stiction_envs.gap.tables.noise import levelled, losses, noise_of
from stiction_envs.gap.tables.readings import Comparison, Readings, TableData
from stiction_envs.gap.tables.settings import TableSettings
from stiction_envs.gap.tables.whole_arm import (
    FRICTION_LEVEL,
    NOMINAL,
    Quantity,
    State,
    WholeArm,
)
from stiction_envs.measured import BaseTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
COARSE = 61
"""Number of values of the unknown that are tried over its range; assumed."""
FINE = 41
"""The same near the best; assumed."""
MOVED = 0.08
"""Change of a quantity's logarithm above which the whole arm is simulated again [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The fit of a hypothesis to the tables, with other hypotheses unchanged."""

    hypothesis: Hypothesis
    x: float
    low: float
    high: float
    """95 % interval of x: of the likelihood, or of the jackknife over blocks if that is wider."""
    on_bound: bool
    held: float
    """Loss of its joints, each block predicted from the others [nats]; inf if not tried."""
    left_out: dict[int, float]
    """x without each block."""


class Model:
    """The readings, the nominal arm, and the accepted hypotheses with their values."""

    def __init__(
        self,
        readings: Readings,
        whole: WholeArm,
        base: BaseTable,
        causes: Sequence[TableCause],
        settings: TableSettings,
    ) -> None:
        """Simulate the nominal arm.

        Args:
            readings: N readings.
            whole: the arm.
            base: base torques.
            causes: causes to try.
            settings: constants of the method.
        """
        self.readings, self.whole = readings, whole
        self.causes, self.settings = tuple(causes), settings
        self.bench = Bench.of(whole.arm, base, whole.friction, whole.protocol)
        self.states = dict.fromkeys(readings.joints, NOMINAL)
        self.values: dict[Hypothesis, float] = {}
        # the states of this diagnosis: simulations of another one must not change its result
        self._seen: dict[int, dict[State, None]] = {j: {} for j in readings.joints}
        self._lone: dict[tuple[int, State], LoneJoint] = {}
        self._anchored: dict[tuple[int, State, int], LoneJoint] = {}
        self.simulated = np.empty(len(readings.all))
        self.simulate(self.states)
        self.data = TableData(
            readings=readings,
            unit=self._unit(),
            loads=whole.poses.signed,
            friction=whole.friction,
        )
        self.noise = np.full(len(readings.all), np.nan)
        self.set_noise()

    def simulate(self, states: Mapping[int, State]) -> None:
        """Simulate the whole arm with some joints in some states."""
        self.whole.simulate([(s, self.readings.jobs(j)) for j, s in states.items()])
        for j, s in states.items():
            self._seen[j][s] = None
        for j, s in self.states.items():
            rows = self.readings.of_joints([j])
            self.simulated[rows] = self.whole.torques(s, self.readings.jobs(j))

    def _unit(self) -> Array:
        """Return (N,) friction of the nominal arm in the pose of each reading [N·m]."""
        r = self.readings
        out = np.ones(len(r.all))
        for level in set(r.level.tolist()):
            some = r.level == level
            out[some] = self.simulated[some & r.base].mean()
        return out

    def set_noise(self) -> None:
        """Estimate the noise again, from the residual with the present values."""
        self.noise = noise_of(self.readings, self.residual(), self.settings.noise)

    def copy(self) -> Model:
        """Return a model that can be changed separately; simulations are shared."""
        new = copy.copy(self)
        new.states, new.values = dict(self.states), dict(self.values)
        new.simulated = self.simulated.copy()
        return new

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities that the causes vary."""
        return tuple(c.quantity for c in self.causes if c.quantity is not None)

    def lone(self, joint: int) -> LoneJoint:
        """Return the lone joint about the joint's present state."""
        state, seen, jobs = self.states[joint], self._seen[joint], self.readings.jobs(joint)
        key = joint, state, len(seen)
        if key not in self._anchored:
            if key[:2] not in self._lone:
                lone = LoneJoint(jobs, self.bench, self.whole, state, self.quantities)
                self._lone[key[:2]] = lone
            known = {s: self.whole.torques(s, jobs) for s in seen}
            self._anchored[key] = self._lone[key[:2]].anchored(known)
        return self._anchored[key]

    def anchor(self, joints: Iterable[int]) -> None:
        """Simulate joints with the whole arm at more values of each quantity."""
        for q in (*self.quantities, FRICTION_LEVEL):
            for factor in q.anchors:
                states = {}
                for j in joints:
                    knots = self.lone(j).knots[q]
                    value = self.whole.value(self.states[j], q) * factor
                    if knots[0] < np.log(value) < knots[-1]:
                        states[j] = self.whole.changed(self.states[j], q, value)
                self.simulate(states)

    def hypotheses(self) -> Iterator[Hypothesis]:
        """Yield all hypotheses that are not accepted yet."""
        r = self.readings
        wheres = {
            j: tuple(sorted({x.where for x in r.all if x.where.joint == j})) for j in r.joints
        }
        taken = {(h.name, h.joints) for h in self.values if not h.cause.repeatable}
        for cause in self.causes:
            for h in cause.statements(wheres):
                if h not in self.values and (h.name, h.joints) not in taken:
                    yield h

    def neutral(self, h: Hypothesis) -> float:
        """Return the x at which a hypothesis changes nothing."""
        q = h.cause.quantity
        if q is None:
            return 0.0
        value = self.whole.value(self.states[h.joints[0]], q)
        return float(np.log(np.clip(value, q.low, q.high)))

    def span(self, h: Hypothesis) -> tuple[float, float]:
        """Return the range of x."""
        q = h.cause.quantity
        if q is None:
            return h.cause.span(self.data, h.where)
        knots = [self.lone(j).knots[q] for j in h.joints]
        return max(float(k[0]) for k in knots), min(float(k[-1]) for k in knots)

    def predict(
        self,
        rows: Index,
        values: Mapping[Hypothesis, float],
        h: Hypothesis | None = None,
        x: Array | None = None,
    ) -> Array:
        """Return (m, rows) predicted readings [N·m], with a hypothesis at each of x (m,).

        Args:
            rows: all readings of some joints.
            values: values of hypotheses.
            h: hypothesis to vary, among them or not; None for none.
            x: its values.
        """
        x = np.zeros(1) if x is None else x
        out = np.tile(self.simulated[rows], (len(x), 1))
        log_level = np.zeros((len(x), len(rows)))
        terms = [(k, np.full(len(x), v)) for k, v in values.items() if k != h]
        for k, v in terms if h is None else [*terms, (h, x)]:
            if k.cause.quantity is not None:
                for j, some in self._by_joint(rows):
                    if j in k.joints:
                        out[:, some] += self.lone(j).shift(k.cause.quantity, v[:, None])
                continue
            concerned = self.readings.of(k.where)[rows]
            if (torque := k.cause.added(self.data, rows)) is not None:
                out += v[:, None] * np.where(concerned, torque, 0.0)
            if (level := k.cause.level(self.data, rows, v)) is not None:
                log_level += np.where(concerned, level, 0.0)
        if log_level.any():
            for j, some in self._by_joint(rows):
                out[:, some] += self.lone(j).shift(FRICTION_LEVEL, log_level[:, some])
        return out

    def _by_joint(self, rows: Index) -> list[tuple[int, Mask]]:
        joint = self.readings.joint[rows]
        return [(j, joint == j) for j in self.readings.joints if (joint == j).any()]

    def predicted(self, values: Mapping[Hypothesis, float] | None = None) -> Array:
        """Return (N,) predicted readings [N·m]; None for the accepted values."""
        values = self.values if values is None else values
        return np.asarray(self.predict(np.arange(len(self.readings.all)), values)[0])

    def comparison(self, without: Model) -> Comparison:
        """Return predictions of this model and of one without some of its causes."""
        return Comparison(data=self.data, with_it=self.predicted(), without=without.predicted())

    def residual(self, values: Mapping[Hypothesis, float] | None = None) -> Array:
        """Return (N,) measured less predicted over friction [-]; None for the accepted values."""
        return np.asarray((self.readings.torque - self.predicted(values)) / self.data.unit)

    def scaled(
        self,
        rows: Index,
        values: Mapping[Hypothesis, float],
        h: Hypothesis | None = None,
        x: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return residuals (m, rows) and the readings' change per log level (rows,), over noise."""
        sd = self.noise[rows] * self.data.unit[rows]
        z = (self.readings.torque[rows] - self.predict(rows, values, h, x)) / sd
        step = np.array([[-0.1], [0.1]])
        slope = np.empty(len(rows))
        for j, some in self._by_joint(rows):
            change = self.lone(j).shift(FRICTION_LEVEL, step)
            slope[some] = (change[1] - change[0]) / 0.2
        return z, slope / sd

    def _profile(
        self, rows: Index, z: Array, slope: Array, used: Mask
    ) -> tuple[Array, Array, Array]:
        """Return the loss of the used readings and levels, of the levels, and of each reading.

        The first two are (m,), the last is (m, rows).
        """
        r = self.readings
        _, level = np.unique(r.level[rows], return_inverse=True)
        shift = r.sign[rows] / self.noise[rows]
        left, cost = levelled(z, slope, shift, level, r.base[rows], used, self.settings.noise)
        each = losses(left, r.base[rows], self.settings.noise)
        return each @ used.astype(float) + cost, cost, each

    def left_over(self) -> Array:
        """Return (N,) residuals over noise after friction levels and offsets were adjusted."""
        r = self.readings
        rows, every = np.arange(len(r.all)), np.ones(len(r.all), dtype=bool)
        z, slope = self.scaled(rows, self.values)
        noise = self.settings.noise
        return levelled(z, slope, r.sign / self.noise, r.level, r.base, every, noise)[0][0]

    def left_out(self, joints: Sequence[int]) -> dict[Hypothesis, dict[int, float]]:
        """Return the values of the hypotheses about some joints, fitted without each block."""
        mine = [h for h in self.values if set(h.joints) & set(joints)]
        return {h: self.fit(h).left_out for h in mine}

    def held(self, joints: Sequence[int], *, refitted: bool) -> float:
        """Return the held-out loss of some joints [nats].

        Args:
            joints: the joints.
            refitted: whether values are fitted without the held-out block, and not only levels.
        """
        left_out = self.left_out(joints) if refitted else {}
        rows = self.readings.of_joints(joints)
        z, slope = self.scaled(rows, self.values)
        # the loss of the levels depends on their calibration, not on held-out blocks
        total = float(self._profile(rows, z, slope, np.ones(len(rows), dtype=bool))[1][0])
        for block, used in self._folds(rows):
            if left_out:
                z, slope = self.scaled(rows, self.without(block, left_out))
            total += float(self._profile(rows, z, slope, used)[2][0, ~used].sum())
        return total

    def without(
        self, block: int, left_out: Mapping[Hypothesis, Mapping[int, float]]
    ) -> dict[Hypothesis, float]:
        """Return the values, some of them fitted without a block."""
        return {h: left_out.get(h, {}).get(block, x) for h, x in self.values.items()}

    def left_out_residual(self) -> Array:
        """Return `residual` (N,) of each block predicted from the others [-]."""
        left_out = self.left_out(self.readings.joints)
        out = np.empty(len(self.readings.all))
        for block in range(len(self.readings.blocks)):
            some = self.readings.block == block
            out[some] = self.residual(self.without(block, left_out))[some]
        return out

    def _folds(self, rows: Index) -> Iterator[tuple[int, Mask]]:
        block = self.readings.block[rows]
        yield from ((int(b), block != b) for b in np.unique(block))

    def fit(self, h: Hypothesis, *, enough: float = -np.inf) -> Fit:
        """Fit a hypothesis with the others unchanged, and predict each left-out block.

        Args:
            h: hypothesis, accepted or not.
            enough: least gain of the fit to all readings over the neutral value [nats]; with less,
                no block is left out.
        """
        rows = self.readings.of_joints(h.joints)
        low, high = self.span(h)
        coarse = np.linspace(low, high, COARSE)
        # the neutral value is always tried
        coarse = np.unique(np.append(coarse, np.clip(self.neutral(h), low, high)))
        every = np.ones(len(rows), dtype=bool)
        z, slope = self.scaled(rows, self.values, h, coarse)
        total, _, _ = self._profile(rows, z, slope, every)
        best = int(total.argmin())
        nothing = int(np.abs(coarse - self.neutral(h)).argmin())
        if total[nothing] - total[best] < enough:
            return Fit(
                hypothesis=h,
                x=float(coarse[best]),
                low=low,
                high=high,
                on_bound=False,
                held=np.inf,
                left_out={},
            )
        step = (high - low) / (COARSE - 1)
        near = coarse[best] + np.linspace(-2 * step, 2 * step, FINE)
        x = np.unique(np.concatenate([coarse, near[(near >= low) & (near <= high)]]))
        z, slope = self.scaled(rows, self.values, h, x)
        total, cost, _ = self._profile(rows, z, slope, every)
        best = int(total.argmin())
        held, left_out = float(cost[best]), {}
        for block, used in self._folds(rows):
            train, _, each = self._profile(rows, z, slope, used)
            k = int(train.argmin())
            left_out[block] = float(x[k])
            held += float(each[k, ~used].sum())
        # half the 95 % quantile of χ² of one degree of freedom
        inside = x[total < total[best] + 1.92]
        # without the base torques a level looks like a drift
        values = np.array([v for b, v in left_out.items() if any(self.readings.blocks[b])])
        m = len(values)
        spread = np.sqrt((m - 1) / m * ((values - values.mean()) ** 2).sum())
        reach = float(student_t.ppf(0.975, max(m - 1, 1)) * spread)
        return Fit(
            hypothesis=h,
            x=float(x[best]),
            low=max(low, min(float(inside[0]), float(x[best]) - reach)),
            high=min(high, max(float(inside[-1]), float(x[best]) + reach)),
            on_bound=bool(min(x[best] - low, high - x[best]) < step / 2),
            held=held,
            left_out=left_out,
        )

    def refit(self) -> None:
        """Adjust the values to each other."""
        for _ in range(2 if len(self.values) > 1 else 1):
            for h in list(self.values):
                self.values[h] = self.fit(h).x

    def accept(self, h: Hypothesis, x: float) -> Fit:
        """Accept a hypothesis, simulate the whole arm with it, and adjust all values."""
        self.values[h] = x
        for _ in range(3):
            moved = self._simulate()
            self.refit()
            if not moved:
                break
        return self.fit(h)

    def drop(self, some: Sequence[Hypothesis]) -> None:
        """Drop hypotheses, and adjust the others."""
        for h in some:
            del self.values[h]
        self._simulate()
        self.refit()

    def _simulate(self) -> bool:
        """Simulate where values have moved by more than `MOVED`; return whether any has."""
        states = dict.fromkeys(self.states, NOMINAL)
        for h, x in self.values.items():
            if h.cause.quantity is not None:
                for j in h.joints:
                    value = float(np.exp(x))
                    states[j] = self.whole.changed(states[j], h.cause.quantity, value)

        def far(a: State, b: State) -> bool:
            pairs = [(self.whole.value(a, q), self.whole.value(b, q)) for q in self.quantities]
            return any(p != q and abs(np.log(p / q)) > MOVED for p, q in pairs)

        moved = {j for j in states if far(states[j], self.states[j])}
        if moved:
            self.states = {j: s if j in moved else self.states[j] for j, s in states.items()}
            self.simulate({j: self.states[j] for j in moved})
        return bool(moved)
