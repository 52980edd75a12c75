"""Statements about an arm, one unknown each, fitted to torque tables and tried on held-out parts.

What is left out is a block, all readings of one dither frequency and scale (or the base torques):
single cells have neighbours that give them away.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from stiction_envs.experiments.sje.protocol import LOADS, Configuration
from stiction_envs.gap.tables.evidence import (
    DYNAMIC,
    LoneJoint,
    Readings,
    State,
    WholeArm,
)
from stiction_envs.gap.tables.model import Bench
from stiction_envs.gap.tables.noise import levelled, losses, noise_of
from stiction_envs.gap.tables.settings import TableSettings, table_settings
from stiction_envs.measured import BaseTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
LEVEL = ("friction_level", "base_drift")
"""Statements that scale friction: on both days, on the day of the dithered torques."""
ADDED = ("torque_offset", "gravity_error")
"""Statements that add a torque."""


@dataclass(frozen=True)
class Hypothesis:
    """One statement, with one unknown x: a logarithm of a factor or cut-off, or N·m."""

    name: str
    where: tuple[Configuration, ...]
    """The configurations that it speaks of."""
    instead: bool = False
    """An asymmetry that takes the place of an offset as large: a nominal model that was calibrated
    to the base torques has that offset, whichever of the two it was."""

    @property
    def joints(self) -> tuple[int, ...]:
        """The joints, in order."""
        return tuple(sorted({w.joint for w in self.where}))


@dataclass(frozen=True, kw_only=True)
class Fit:
    """What the tables say about a hypothesis, other hypotheses as they are."""

    hypothesis: Hypothesis
    x: float
    low: float
    high: float
    """95 % interval of x: of the likelihood, or of the jackknife over blocks if that is wider."""
    on_bound: bool
    loss: float
    """Over its joints, all readings used [nats]."""
    held: float
    """Over its joints, each block predicted from the others [nats]; inf if not tried."""
    left_out: dict[int, float]
    """x without each block."""


class Model:
    """Nominal arm, the hypotheses taken on so far, and the readings."""

    def __init__(
        self,
        readings: Readings,
        whole: WholeArm,
        base: BaseTable,
        settings: TableSettings | None = None,
    ) -> None:
        """Simulate the nominal arm.

        Args:
            readings: N of them.
            whole: the arm.
            base: base torques.
            settings: constants of the method; None for those of ``settings.toml``.
        """
        self.readings, self.whole = readings, whole
        self.settings = settings or table_settings()
        bench = Bench.of(whole.arm, base, whole.friction)
        self.bench = bench.replace(interface=whole.interface, protocol=whole.protocol)
        self.loads = whole.poses.signed
        self.states = dict.fromkeys(readings.joints, whole.nominal)
        self.values: dict[Hypothesis, float] = {}
        # what this diagnosis has looked at: another's simulations must not change its result
        self._seen: dict[int, set[State]] = {j: set() for j in readings.joints}
        self._lone: dict[tuple[int, State, int], LoneJoint] = {}
        self.simulated = np.empty(len(readings.all))
        self.simulate(self.states)
        self.unit = self._unit()
        self.noise = np.full(len(readings.all), np.nan)
        self.set_noise()

    def simulate(self, states: Mapping[int, State]) -> None:
        """Simulate the whole arm with some joints in some states, and look at it."""
        self.whole.simulate([(s, self.readings.jobs(j)) for j, s in states.items()])
        for j, s in states.items():
            self._seen[j].add(s)
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
        """Find the noise again, from the residual of the present state."""
        self.noise = noise_of(self.readings, self.residual(), self.settings.noise)

    def copy(self) -> Model:
        """Return a model that can be changed on its own; simulations are shared."""
        new = object.__new__(Model)
        own = ("states", "values", "simulated")
        new.__dict__ = {**self.__dict__, **{k: copy.copy(getattr(self, k)) for k in own}}
        return new

    def lone(self, joint: int) -> LoneJoint:
        """Return the lone joint about the present state."""
        state, seen = self.states[joint], self._seen[joint]
        key = joint, state, len(seen)
        if key not in self._lone:
            jobs = self.readings.jobs(joint)
            known = {s: self.whole.torques(s, jobs) for s in seen}
            self._lone[key] = self.whole.lone(
                state, jobs, self.bench, self.settings.statements
            ).anchored(known)
        return self._lone[key]

    def hypotheses(self) -> Iterator[Hypothesis]:
        """Yield all statements that are not taken on yet."""
        r = self.readings
        wheres = {j: tuple(sorted({x.where for x in r.all if x.where.joint == j}))
                  for j in r.joints}  # fmt: skip
        every = [Hypothesis("low_pass", tuple(w for some in wheres.values() for w in some))]
        for some in wheres.values():
            poses = [tuple(w for w in some if w.load == load) for load in LOADS]
            for name in ("rotor_inertia", "presliding", *ADDED, "direction_asymmetry"):
                every.append(Hypothesis(name, some))
            every.append(Hypothesis("direction_asymmetry", some, instead=True))
            for name in LEVEL:
                every += [Hypothesis(name, where) for where in (some, *poses)]
            every += [Hypothesis("base_drift", (w,)) for w in some]
        said = {(h.name, h.joints) for h in self.values if h.name not in LEVEL}
        yield from (h for h in every if h not in self.values and (h.name, h.joints) not in said)

    def neutral(self, h: Hypothesis) -> float:
        """Return the x at which a hypothesis says nothing new."""
        if h.name not in DYNAMIC:
            return 0.0
        low, high = getattr(self.settings.statements, h.name)
        value = getattr(self.states[h.joints[0]], h.name)
        return float(np.log(np.clip(value, low, high)))

    def span(self, h: Hypothesis) -> tuple[float, float]:
        """Return the range of x."""
        s = self.settings.statements
        if h.name in DYNAMIC:
            knots = [self.lone(j).knots[h.name] for j in h.joints]
            return max(float(k[0]) for k in knots), min(float(k[-1]) for k in knots)
        if h.name in LEVEL:
            return float(np.log(s.friction_level[0])), float(np.log(s.friction_level[1]))
        rows = self.readings.of(h.where)
        most = s.most_added * float(self.unit[rows].min())
        if h.name == "gravity_error":
            load = float(np.abs(self.loads[h.joints[0] - 1]).max())
            most = min(most / max(load, 1e-9), s.most_gravity_error)
        return -most, most

    def predict(
        self,
        rows: Index,
        values: Mapping[Hypothesis, float],
        h: Hypothesis | None = None,
        x: Array | None = None,
    ) -> Array:
        """Return (m, rows) readings [N·m] with some values taken on, and h at each of x (m,).

        Args:
            rows: all readings of some joints.
            values: what is taken on.
            h: a hypothesis whose value is varied, taken on or not.
            x: its values.
        """
        r = self.readings
        x = np.zeros(1) if x is None else x
        out = np.tile(self.simulated[rows], (len(x), 1))
        log_level = np.zeros((len(x), len(rows)))
        terms = [(k, np.full(len(x), v)) for k, v in values.items() if k != h]
        for k, v in terms if h is None else [*terms, (h, x)]:
            if k.name in DYNAMIC:
                for j, some in self._by_joint(rows):
                    if j in k.joints:
                        out[:, some] += self.lone(j).shift(k.name, v)
                continue
            mine = r.of(k.where)[rows]
            if k.name in ADDED:
                load = self.loads[r.joint[rows] - 1, r.pose[rows]]
                scale = r.sign[rows] * (load if k.name == "gravity_error" else 1.0)
                out += v[:, None] * np.where(mine, scale, 0.0)
            elif k.name == "direction_asymmetry":
                relative = v[:, None] * r.sign[rows] / self.unit[rows]
                log_level += np.where(mine, np.log1p(np.clip(relative, -0.9, 9.0)), 0.0)
                if k.instead:
                    out -= v[:, None] * np.where(mine, r.sign[rows], 0.0)
            else:
                log_level += v[:, None] * (mine & ~(r.base[rows] & (k.name == "base_drift")))
        if log_level.any():
            for j, some in self._by_joint(rows):
                out[:, some] += self.lone(j).level_shift(log_level[:, some])
        return out

    def _by_joint(self, rows: Index) -> list[tuple[int, Mask]]:
        joint = self.readings.joint[rows]
        return [(j, joint == j) for j in self.readings.joints if (joint == j).any()]

    def residual(self, values: Mapping[Hypothesis, float] | None = None) -> Array:
        """Return (N,) measured less predicted over friction, with the values taken on [-]."""
        rows = np.arange(len(self.readings.all))
        predicted = self.predict(rows, self.values if values is None else values)[0]
        return np.asarray((self.readings.torque - predicted) / self.unit)

    def scaled(
        self, rows: Index, values: Mapping[Hypothesis, float], h: Hypothesis | None, x: Array
    ) -> tuple[Array, Array]:
        """Return residuals over noise (m, rows), and what the friction level does to them."""
        sd = self.noise[rows] * self.unit[rows]
        z = (self.readings.torque[rows] - self.predict(rows, values, h, x)) / sd
        step = np.array([[-0.1], [0.1]])
        slope = np.empty(len(rows))
        for j, some in self._by_joint(rows):
            change = self.lone(j).level_shift(step * np.ones(int(some.sum())))
            slope[some] = (change[1] - change[0]) / 0.2
        return z, slope / sd

    def _profile(
        self, rows: Index, z: Array, slope: Array, used: Mask
    ) -> tuple[Array, Array, Array]:
        """Return losses of the used readings, of the levels alone, both (m,), and of each reading.

        The first contains the second; the last is (m, rows).
        """
        r = self.readings
        _, level = np.unique(r.level[rows], return_inverse=True)
        shift = r.sign[rows] / self.noise[rows]
        left, cost = levelled(z, slope, shift, level, r.base[rows], used, self.settings.noise)
        each = losses(left, r.base[rows], self.settings.noise)
        return each @ used.astype(float) + cost, cost, each

    def left_over(self) -> Array:
        """Return (N,) residuals over noise, friction levels and offsets adjusted."""
        r = self.readings
        rows, every = np.arange(len(r.all)), np.ones(len(r.all), dtype=bool)
        z, slope = self.scaled(rows, self.values, None, np.zeros(1))
        noise = self.settings.noise
        return levelled(z, slope, r.sign / self.noise, r.level, r.base, every, noise)[0][0]

    def held_now(self, joints: tuple[int, ...]) -> float:
        """Return the held-out loss of some joints, only friction levels held out [nats]."""
        return self._held(joints, {})

    def held(self, joints: tuple[int, ...]) -> float:
        """Return the held-out loss of some joints, all values fitted without the block [nats]."""
        return self._held(joints, self.left_out(joints))

    def left_out(self, joints: tuple[int, ...]) -> dict[Hypothesis, dict[int, float]]:
        """Return the values of what concerns some joints, without each block."""
        mine = [h for h in self.values if set(h.joints) & set(joints)]
        return {h: self.fit(h).left_out for h in mine}

    def _held(
        self, joints: tuple[int, ...], left_out: Mapping[Hypothesis, Mapping[int, float]]
    ) -> float:
        rows = self.readings.of_joints(joints)
        total, none = 0.0, np.zeros(1)
        z, slope = self.scaled(rows, self.values, None, none)
        # what the levels are off is told by no block, but by how well they were calibrated
        total += float(self._profile(rows, z, slope, np.ones(len(rows), dtype=bool))[1][0])
        for block, used in self._folds(rows):
            if left_out:
                z, slope = self.scaled(rows, self.without(block, left_out), None, none)
            total += float(self._profile(rows, z, slope, used)[2][0, ~used].sum())
        return total

    def without(
        self, block: int, left_out: Mapping[Hypothesis, Mapping[int, float]]
    ) -> dict[Hypothesis, float]:
        """Return the values, those of some hypotheses fitted without a block."""
        return {h: left_out.get(h, {}).get(block, x) for h, x in self.values.items()}

    def left_out_residual(self) -> Array:
        """Return (N,) measured less predicted over friction, each block from the others [-]."""
        left_out = self.left_out(tuple(self.readings.joints))
        out = np.empty(len(self.readings.all))
        for block in range(len(self.readings.blocks)):
            some = self.readings.block == block
            out[some] = self.residual(self.without(block, left_out))[some]
        return out

    def _folds(self, rows: Index) -> Iterator[tuple[int, Mask]]:
        block = self.readings.block[rows]
        yield from ((int(b), block != b) for b in np.unique(block))

    def fit(self, h: Hypothesis, *, enough: float = -np.inf) -> Fit:
        """Fit a hypothesis with the others as they are, and try it on each block left out.

        Args:
            h: taken on already or not.
            enough: held-out trials are skipped if even with all readings used less is gained than
                this against saying nothing [nats].
        """
        rows, s = self.readings.of_joints(h.joints), self.settings.statements
        low, high = self.span(h)
        coarse = np.linspace(low, high, s.coarse)
        # saying nothing is always among what is tried
        coarse = np.unique(np.append(coarse, np.clip(self.neutral(h), low, high)))
        every = np.ones(len(rows), dtype=bool)
        z, slope = self.scaled(rows, self.values, h, coarse)
        total, _, _ = self._profile(rows, z, slope, every)
        best = int(total.argmin())
        nothing = int(np.abs(coarse - self.neutral(h)).argmin())
        if total[nothing] - total[best] < enough:
            return Fit(hypothesis=h, x=float(coarse[best]), low=low, high=high, on_bound=False,
                       loss=float(total[best]), held=np.inf, left_out={})  # fmt: skip
        step = (high - low) / (s.coarse - 1)
        near = coarse[best] + np.linspace(-2 * step, 2 * step, s.fine)
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
        inside = x[total < total[best] + 1.92]
        # without the base torques nothing tells a level from a drift
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
            loss=float(total[best]),
            held=held,
            left_out=left_out,
        )

    def refit(self, sweeps: int = 2) -> None:
        """Adjust the values to each other."""
        for _ in range(sweeps if len(self.values) > 1 else 1):
            for h in list(self.values):
                self.values[h] = self.fit(h).x

    def take(self, h: Hypothesis, x: float) -> Fit:
        """Take a hypothesis on, simulate the whole arm with it, and adjust all values."""
        self.values[h] = x
        for _ in range(3):
            moved = self._simulate()
            self.refit()
            if not moved:
                break
        return self.fit(h)

    def drop(self, some: tuple[Hypothesis, ...]) -> None:
        """Take hypotheses back, and adjust the others."""
        for h in some:
            del self.values[h]
        self._simulate()
        self.refit()

    def _simulate(self) -> bool:
        """Simulate where the values have moved by more than 8 %; say whether any has."""
        states = dict.fromkeys(self.states, self.whole.nominal)
        for h, x in self.values.items():
            if h.name in DYNAMIC:
                for j in h.joints:
                    states[j] = states[j].on(h.name, x)

        def far(a: State, b: State) -> bool:
            pairs = zip(dataclasses.astuple(a), dataclasses.astuple(b), strict=True)
            return any(p != q and abs(np.log(p / q)) > 0.08 for p, q in pairs)

        moved = {j for j in states if far(states[j], self.states[j])}
        if moved:
            self.states = {j: s if j in moved else self.states[j] for j, s in states.items()}
            self.simulate({j: self.states[j] for j in moved})
        return bool(moved)
