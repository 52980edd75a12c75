"""Prediction of all readings of torque tables by an arm with causes.

The prediction is the whole arm's (`WholeArm`) in the last simulated state x₀. Fast simulations of a
lone joint predict changes from there:

    W(x) ≈ W(x₀) + lone(x) − lone(x₀)
"""

from collections.abc import Mapping, Sequence

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.friction.lone_joint import LoneJoints, breakaway
from stiction_envs.friction.parameters import bristle_damping
from stiction_envs.gap.tables.data import (
    FRICTION_LEVEL,
    NOMINAL,
    STEP,
    Effect,
    SimulatedQuantity,
    State,
    TableData,
    WholeArm,
)
from stiction_envs.plant import CONTROL_DT

Values = Mapping[Effect, float]
"""Effects in an arm: x of each effect."""
States = Mapping[int, State]
"""The state from which each joint (from 1) is predicted."""
LEVEL_STEP = 0.1
"""Step of the logarithm of friction for its slope [-]; assumed."""
Column = tuple[float, float, float, float]
"""(stiction, link inertia, dither frequency, amplitude)."""
KNOTS = 21
"""Number of values of a quantity at which the lone joint is simulated; assumed."""
LEVEL_KNOTS = 9
"""The same of the friction level; assumed."""
STUCK = 3.0
"""Torque at which ramps end, over the largest friction [-]; assumed."""
FREE = (
    *("coulomb_ratio", "stribeck_velocity", "bristle_stiffness", "viscous", "rotor_inertia"),
    *("joint_stiffness", "ramp_rate", "lowpass_hz", "torque_rate"),
)
"""Parameters of a lone joint that may have other than nominal values."""
STABLE = 1.6
"""Largest h·σ1/J with which a bristle counts as stable [-]; assumed: the limit is 2 (sources.md
3.5), and the arm's inertia is not the lone joint's."""


class LoneJointTorques:
    """Breakaway torques of a lone joint at any levels, by fast simulation."""

    def __init__(self, joint: int, whole: WholeArm) -> None:
        """Take a joint (from 1) of the nominal arm."""
        self.joint, self.whole = joint, whole
        self._zeta = float(whole.friction.bristle_damping_ratio[joint - 1])

    def nominal(self, name: str) -> float:
        """Return the nominal value of a parameter."""
        w, j = self.whole, self.joint - 1
        of_experiment = {
            "ramp_rate": w.protocol.ramp_rate,
            "torque_rate": w.interface.torque_rate[j],
            "lowpass_hz": w.interface.lowpass_hz or np.inf,
        }
        return float(of_experiment.get(name) or np.mean(getattr(w.friction, name)[j]))

    def breakaway(
        self,
        columns: Sequence[Column],
        population: Sequence[Mapping[str, float]],
        hold: int | None = None,
    ) -> Array:
        """Return (population, columns) breakaway torque without offset [N·m].

        A population's parameters are by name; others are nominal. A commanded torque is held for
        ``hold`` steps; None for the torque interface's.
        """
        level, link, frequency, amplitude = np.tile(np.array(columns).T, len(population))
        p = {
            name: np.repeat([x.get(name, self.nominal(name)) for x in population], len(columns))
            for name in FREE
        }
        rotor, spring = p["rotor_inertia"], p["joint_stiffness"]
        elastic = np.isfinite(spring)
        carried = np.where(elastic, rotor, rotor + link)
        damping = self.whole.friction.joint_damping_ratio[self.joint - 1]
        zeta = np.full(len(level), self._zeta)
        lone = LoneJoints(
            stiction=level,
            bristle_damping=bristle_damping(p["bristle_stiffness"], zeta, carried, CONTROL_DT),
            joint_damping=2 * damping * np.sqrt(np.where(elastic, spring, 0.0) * rotor),
            link_inertia=link,
            amplitude=amplitude,
            frequency=frequency,
            **p,
        )
        tau = breakaway(
            lone,
            threshold=self.whole.protocol.threshold,
            longest=STUCK * float(level.max()) / float(lone.ramp_rate.min()),
            hold=self.whole.interface.hold_steps if hold is None else hold,
        )
        return tau.reshape(len(population), len(columns))

    def readings(self, keys: Sequence[Column], population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, keys) breakaway torque [N·m]; a stuck joint reads far too much."""
        columns = sorted(set(keys))
        tau = self.breakaway(columns, population)[:, [columns.index(key) for key in keys]]
        return np.where(np.isfinite(tau), tau, 4.0 * max(key[0] for key in columns))

    def of(self, values: Mapping[SimulatedQuantity, float]) -> dict[str, float]:
        """Return parameters by name for the values of some quantities."""
        out: dict[str, float] = {}
        for q, x in values.items():
            for f in q.fields:
                out[f] = x if q.of_interface else out.get(f, self.nominal(f)) * x
        return out

    def holds(self, p: Mapping[str, float], link: float) -> bool:
        """Return whether the bristle is stable, given parameters and link inertia [kg·m²]."""
        carried = p.get("rotor_inertia", self.nominal("rotor_inertia")) + link
        stiffness = p.get("bristle_stiffness", self.nominal("bristle_stiffness"))
        zeta, one = np.array([self._zeta]), np.ones(1)
        damping = bristle_damping(stiffness * one, zeta, carried * one, CONTROL_DT)
        return bool(CONTROL_DT * damping[0] < STABLE * carried)


class LoneJoint:
    """Changes of a joint's readings with each quantity, by simulations of one joint."""

    def __init__(
        self,
        jobs: Sequence[Job],
        whole: WholeArm,
        state: State,
        quantities: Sequence[SimulatedQuantity],
    ) -> None:
        """Simulate the jobs of one joint with other quantities, and another friction level."""
        joint = jobs[0].configuration.joint
        torques, places = LoneJointTorques(joint, whole), [x.configuration.index[:2] for x in jobs]
        keys: list[Column] = [
            (float(whole.level[at]), float(whole.link[at]), x.frequency_hz, x.amplitude_nm)
            for x, at in zip(jobs, places, strict=True)
        ]
        here = {q: whole.value(state, q) for q in quantities}
        link = 0.0 if whole.friction.elastic[joint - 1] else min(key[1] for key in keys)
        self._tables: dict[SimulatedQuantity, tuple[Array, Array]] = {}
        for q in quantities:
            every = np.linspace(np.log(q.low), np.log(q.high), KNOTS).tolist()
            some = {x: torques.of({**here, q: float(np.exp(x))}) for x in every}
            if not q.of_interface:  # values with which the bristle chatters are left out
                some = {x: p for x, p in some.items() if torques.holds(p, link)}
            self._tables[q] = np.array(list(some)), torques.readings(keys, list(some.values()))
        levels = np.linspace(np.log(FRICTION_LEVEL.low), np.log(FRICTION_LEVEL.high), LEVEL_KNOTS)
        scaled = [(f * key[0], *key[1:]) for f in np.exp(levels).tolist() for key in keys]
        flat = torques.readings(scaled, [torques.of(here)])
        self._tables[FRICTION_LEVEL] = levels, flat.reshape(len(levels), -1)
        self._here = {q: self._at(q, np.log(whole.value(state, q))) for q in self._tables}

    def ends(self, q: SimulatedQuantity) -> tuple[float, float]:
        """Return the logarithms between which a quantity is simulated."""
        return float(self._tables[q][0][0]), float(self._tables[q][0][-1])

    def _at(self, q: SimulatedQuantity, log: Array | float) -> Array:
        """Return (rows,) readings, interpolated at the logarithm of a value, one or (rows,)."""
        knots, table = self._tables[q]
        at = np.interp(log, knots, np.arange(len(knots)))
        i = np.minimum(at.astype(int), len(table) - 2)
        t, row = at - i, np.arange(table.shape[1])
        return np.asarray((1 - t) * table[i, row] + t * table[i + 1, row])

    def shift(self, q: SimulatedQuantity, log: Array | float) -> Array:
        """Return (rows,) change of the readings [N·m] from the state, as of `_at`."""
        return self._at(q, log) - self._here[q]


class Predictor:
    """The arm, its lone joints, and the readings that they predict."""

    def __init__(self, data: TableData, quantities: Sequence[SimulatedQuantity]) -> None:
        """Take the tables, and what simulations vary."""
        self.data, self.whole, self.quantities = data, data.whole, tuple(quantities)
        self._lone: dict[tuple[int, State], LoneJoint] = {}
        self._jobs = {j: [data.jobs[i] for i in rows] for j, rows in data.of_joint.items()}
        self._log = {q: float(np.log(self.whole.neutral(q))) for q in self.quantities}

    def bounds(self, e: Effect) -> tuple[float, float]:
        """Return the least and the largest x of an effect."""
        if (q := e.quantity) is None:
            return -e.most, e.most
        low, high = zip(*(self._of(j, NOMINAL).ends(q) for j in e.joints), strict=True)
        return max(low) - self._log[q], min(high) - self._log[q]

    def _of(self, joint: int, state: State) -> LoneJoint:
        key = joint, state
        if key not in self._lone:
            self._lone[key] = LoneJoint(self._jobs[joint], self.whole, state, self.quantities)
        return self._lone[key]

    def states(self, values: Values, now: States | None = None) -> States:
        """Simulate the whole arm near some values; return its states: those of ``now`` if near."""
        states = {j: self._state(j, values, (now or {}).get(j)) for j in self.data.joints}
        self.whole.simulate([(state, self._jobs[j]) for j, state in states.items()])
        return states

    def _state(self, joint: int, values: Values, now: State | None) -> State:
        log = dict.fromkeys(self.quantities, 0.0)
        for e, x in values.items():
            if e.quantity is not None and joint in e.joints:
                log[e.quantity] += x
        here = dict(now or ())
        if now is not None and all(abs(x - STEP * here.get(q, 0)) <= STEP for q, x in log.items()):
            return now
        return frozenset((q, steps) for q, x in log.items() if (steps := round(x / STEP)))

    def of_joint(self, joint: int, state: State, values: Values) -> Array:
        """Return (rows,) predicted readings of a joint from a simulated state [N·m]."""
        lone, out = self._of(joint, state), self.whole.torques(state, self._jobs[joint])
        log = dict(self._log)
        for e, x in values.items():
            if joint in e.joints and e.quantity is not None:
                log[e.quantity] += x
            elif joint in e.joints and e.torque is not None:
                out[self._places(joint, e)] += x * e.torque
        for q, to in log.items():
            out += lone.shift(q, to)
        return out + lone.shift(FRICTION_LEVEL, self._level(joint, values))

    def level_slope(self, joint: int, state: State, values: Values) -> Array:
        """Return (rows,) change of a joint's readings per logarithm of friction [N·m]."""
        lone, level = self._of(joint, state), self._level(joint, values)
        low, high = (lone.shift(FRICTION_LEVEL, level + d) for d in (-LEVEL_STEP, LEVEL_STEP))
        return np.asarray((high - low) / (2 * LEVEL_STEP))

    def _level(self, joint: int, values: Values) -> Array:
        level = np.zeros(len(self.data.of_joint[joint]))
        for e, x in values.items():
            if joint in e.joints and e.level is not None:
                level[self._places(joint, e)] += e.level(x)
        return level

    def _places(self, joint: int, e: Effect) -> Index:
        return np.searchsorted(self.data.of_joint[joint], e.rows)

    def predict(self, states: States, values: Values) -> Array:
        """Return (N,) predicted readings [N·m]."""
        out = np.empty(len(self.data.jobs))
        for j, rows in self.data.of_joint.items():
            out[rows] = self.of_joint(j, states[j], values)
        return out
