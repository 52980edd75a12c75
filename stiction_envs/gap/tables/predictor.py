"""Predicts all readings of torque tables, given what is wrong with the arm.

The whole arm is simulated in a state near the values; a lone joint predicts the change from there
to the values (`lone_joint`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.tables.data import Effect, TableData
from stiction_envs.gap.tables.lone_joint import LoneJoint
from stiction_envs.gap.tables.whole_arm import FRICTION_LEVEL, NOMINAL, STEP, Quantity, State

Array = NDArray[np.float64]
Values = Mapping[Effect, float]
"""What is wrong with the arm, and how much: x of each effect."""
States = Mapping[int, State]
"""The state from which each joint (from 1) is predicted."""
LEVEL_STEP = 0.1
"""Step of the logarithm of friction for its slope [-]; assumed."""


class Predictor:
    """The arm, its lone joints, and the readings that they predict."""

    def __init__(self, data: TableData, quantities: Sequence[Quantity]) -> None:
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

    def _places(self, joint: int, e: Effect) -> NDArray[np.int64]:
        return np.searchsorted(self.data.of_joint[joint], e.rows)

    def predict(self, states: States, values: Values) -> Array:
        """Return (N,) predicted readings [N·m]."""
        out = np.empty(len(self.data.jobs))
        for j, rows in self.data.of_joint.items():
            out[rows] = self.of_joint(j, states[j], values)
        return out
