"""Predicts all readings of torque tables, given what is wrong with the arm.

The whole arm is simulated in a state near the values; a lone joint predicts the change from there
to the values (`lone_joint`). States are whole steps of the logarithms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.tables.causes.base import Hypothesis
from stiction_envs.gap.tables.lone_joint import Bench, LoneJoint
from stiction_envs.gap.tables.readings import Readings, TableData
from stiction_envs.gap.tables.whole_arm import (
    FRICTION_LEVEL,
    NOMINAL,
    Quantity,
    State,
    WholeArm,
)
from stiction_envs.measured import BaseTable

Array = NDArray[np.float64]
Values = Mapping[Hypothesis, float]
"""What is wrong with the arm, and how much: x of each hypothesis."""
STEP = 0.1
"""Step of a quantity's logarithm between states of the whole arm [-]; assumed."""
LEVEL_STEP = 0.1
"""Step of the logarithm of friction for its slope [-]; assumed."""


class Predictor:
    """The arm, its lone joints, and the readings that they predict."""

    def __init__(
        self, readings: Readings, whole: WholeArm, base: BaseTable, quantities: Sequence[Quantity]
    ) -> None:
        """Simulate the nominal arm."""
        self.readings, self.whole, self.quantities = readings, whole, tuple(quantities)
        self._bench = Bench.of(whole.arm, base, whole.friction, whole.protocol)
        self._lone: dict[tuple[int, State], LoneJoint] = {}
        self.rows = {j: readings.of_joints([j]) for j in readings.joints}
        self._jobs = {j: readings.jobs(j) for j in readings.joints}
        self._at = {j: {int(row): k for k, row in enumerate(rows)} for j, rows in self.rows.items()}
        unit = np.ones(len(readings.all))
        self.data = TableData(readings=readings, unit=unit, whole=whole)
        self._logs = {q: float(np.log(self.data.neutral(q))) for q in self.quantities}
        nominal = self.around({}).predict({})
        for level in np.unique(readings.level):
            some = readings.level == level
            unit[some] = nominal[some & readings.base].mean()

    def state(self, joint: int, values: Values, now: State | None = None) -> State:
        """Return the state of the whole arm from which a joint is predicted: ``now`` if near."""
        state, near = NOMINAL, True
        for q in self.quantities:
            x = sum(v for h, v in values.items() if h.cause.quantity is q and joint in h.joints)
            if steps := round(x / STEP):
                factor = float(np.exp(STEP * steps))
                state = self.whole.changed(state, q, self.data.neutral(q) * factor)
            if now is not None:
                here = np.clip(self.whole.value(now, q), q.low, q.high) / self.data.neutral(q)
                near = near and abs(x - float(np.log(here))) <= STEP
        return now if now is not None and near else state

    def bounds(self, h: Hypothesis) -> tuple[float, float]:
        """Return the least and the largest x of a hypothesis."""
        if (q := h.cause.quantity) is None:
            return h.cause.bounds(self.data, h)
        knots = [self._of(j, NOMINAL).knots[q] - np.log(self.data.neutral(q)) for j in h.joints]
        return max(float(k[0]) for k in knots), min(float(k[-1]) for k in knots)

    def _of(self, joint: int, state: State) -> LoneJoint:
        if (joint, state) not in self._lone:
            self._lone[joint, state] = LoneJoint(
                self._jobs[joint], self._bench, self.whole, state, self.quantities
            )
        return self._lone[joint, state]

    def around(self, values: Values, now: Mapping[int, State] | None = None) -> Around:
        """Simulate the whole arm near some values, unless the states ``now`` are near.

        Returns:
            What predicts from there.
        """
        states = {j: self.state(j, values, (now or {}).get(j)) for j in self.readings.joints}
        self.whole.simulate([(state, self._jobs[j]) for j, state in states.items()])
        return Around(self, states)

    def of_joint(self, joint: int, state: State, values: Values) -> Array:
        """Return (rows,) predicted readings of a joint from a state, which was simulated [N·m]."""
        here = dict(self._logs)
        lone, out = self._of(joint, state), self.whole.torques(state, self._jobs[joint])
        level = self._level(joint, values)
        for h, x in values.items():
            if joint not in h.joints:
                continue
            if h.cause.quantity is not None:
                here[h.cause.quantity] += x
            elif (torque := h.cause.torque(self.data, h)) is not None:
                out[self._places(joint, h)] += x * torque
        for q, log in here.items():
            out += lone.shift(q, log)
        return out + lone.shift(FRICTION_LEVEL, level)

    def level_slope(self, joint: int, state: State, values: Values) -> Array:
        """Return (rows,) change of a joint's readings per logarithm of friction [N·m]."""
        lone, level = self._of(joint, state), self._level(joint, values)
        ends = [lone.shift(FRICTION_LEVEL, level + d) for d in (-LEVEL_STEP, LEVEL_STEP)]
        return np.asarray((ends[1] - ends[0]) / (2 * LEVEL_STEP))

    def _level(self, joint: int, values: Values) -> Array:
        level = np.zeros(len(self.rows[joint]))
        for h, x in values.items():
            if joint in h.joints and (more := h.cause.level(self.data, h, x)) is not None:
                level[self._places(joint, h)] += more
        return level

    def _places(self, joint: int, h: Hypothesis) -> list[int]:
        return [self._at[joint][i] for i in h.rows]


@dataclass(frozen=True)
class Around:
    """Predictions from one state of each joint."""

    predictor: Predictor
    states: Mapping[int, State]

    def of_joint(self, joint: int, values: Values) -> Array:
        """Return (rows,) predicted readings of a joint [N·m]."""
        return self.predictor.of_joint(joint, self.states[joint], values)

    def level_slope(self, joint: int, values: Values) -> Array:
        """Return (rows,) change of a joint's readings per logarithm of friction [N·m]."""
        return self.predictor.level_slope(joint, self.states[joint], values)

    def predict(self, values: Values) -> Array:
        """Return (N,) predicted readings [N·m]."""
        out = np.empty(len(self.predictor.readings.all))
        for j, rows in self.predictor.rows.items():
            out[rows] = self.of_joint(j, values)
        return out
