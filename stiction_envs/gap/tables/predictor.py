"""Predicts all readings of torque tables, given what is wrong with the arm.

The whole arm is simulated in a state near the values; a lone joint predicts the change from there
to the values (`lone_joint`). States are whole steps of the logarithms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.tables.data import Effect, TableData
from stiction_envs.gap.tables.lone_joint import Bench, LoneJoint
from stiction_envs.gap.tables.whole_arm import FRICTION_LEVEL, NOMINAL, Quantity, State
from stiction_envs.measured import BaseTable

Array = NDArray[np.float64]
Values = Mapping[Effect, float]
"""What is wrong with the arm, and how much: x of each effect."""
States = Mapping[int, State]
"""The state from which each joint (from 1) is predicted."""
STEP = 0.1
"""Step of a quantity's logarithm between states of the whole arm [-]; assumed."""
LEVEL_STEP = 0.1
"""Step of the logarithm of friction for its slope [-]; assumed."""


class Predictor:
    """The arm, its lone joints, and the readings that they predict."""

    def __init__(self, data: TableData, base: BaseTable, quantities: Sequence[Quantity]) -> None:
        """Take the tables, and what simulations vary."""
        self.data, self.whole, self.quantities = data, data.whole, tuple(quantities)
        whole = data.whole
        self._bench = Bench.of(whole.arm, base, whole.friction, whole.protocol)
        self._lone: dict[tuple[int, State], LoneJoint] = {}
        self._jobs = {j: [data.jobs[i] for i in rows] for j, rows in data.of_joint.items()}
        self._log = {q: float(np.log(data.neutral(q))) for q in self.quantities}

    def bounds(self, e: Effect) -> tuple[float, float]:
        """Return the least and the largest x of an effect."""
        if e.quantity is None:
            return e.low, e.high
        knots = [self._of(j, NOMINAL).knots[e.quantity] - self._log[e.quantity] for j in e.joints]
        return max(float(k[0]) for k in knots), min(float(k[-1]) for k in knots)

    def _of(self, joint: int, state: State) -> LoneJoint:
        if (joint, state) not in self._lone:
            self._lone[joint, state] = LoneJoint(
                self._jobs[joint], self._bench, self.whole, state, self.quantities
            )
        return self._lone[joint, state]

    def states(self, values: Values, now: States | None = None) -> States:
        """Simulate the whole arm near some values; return its states: those of ``now`` if near."""
        states = {j: self._state(j, values, (now or {}).get(j)) for j in self.data.joints}
        self.whole.simulate([(state, self._jobs[j]) for j, state in states.items()])
        return states

    def _state(self, joint: int, values: Values, now: State | None) -> State:
        state, near = NOMINAL, now is not None
        for q in self.quantities:
            x = sum(v for e, v in values.items() if e.quantity is q and joint in e.joints)
            neutral = self.data.neutral(q)
            if steps := round(x / STEP):
                state = self.whole.changed(state, q, neutral * float(np.exp(STEP * steps)))
            if now is not None:
                here = np.clip(self.whole.value(now, q), q.low, q.high) / neutral
                near = near and abs(x - float(np.log(here))) <= STEP
        return now if now is not None and near else state

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

    def _places(self, joint: int, e: Effect) -> NDArray[np.int64]:
        return np.searchsorted(self.data.of_joint[joint], e.rows)

    def predict(self, states: States, values: Values) -> Array:
        """Return (N,) predicted readings [N·m]."""
        out = np.empty(len(self.data.jobs))
        for j, rows in self.data.of_joint.items():
            out[rows] = self.of_joint(j, states[j], values)
        return out
