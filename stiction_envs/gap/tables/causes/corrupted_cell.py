"""One bad reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.gap.tables.causes.base import Array, Hypothesis, TableCause
from stiction_envs.gap.tables.readings import Readings, TableData


@dataclass(frozen=True)
class CorruptedCell(TableCause):
    """A reading far from what the model says, while its neighbours and repeats are not.

    A base torque may be bad although the simulation agrees with it: friction was calibrated to it,
    and then all dithered torques of its configuration are off by one factor.
    """

    name, parameter = "corrupted_cell", "error_nm"
    trials = (1.0,)
    separate = True
    odds = -1.0
    calibrated: ClassVar[float] = 0.1
    """Prior size of the logarithm of that factor [-]; assumed."""
    SIZE: ClassVar[float] = 0.5
    """Prior size of a bad reading's error over friction [-]; assumed."""
    of_base: bool = False
    """Whether friction was calibrated to the bad reading."""

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield each reading, and each base torque to which friction was calibrated."""
        for i, joint in enumerate(readings.joint.tolist()):
            yield Hypothesis(self, (joint,), (i,), str(i))
        for joint in readings.joints:
            yield from (
                Hypothesis(CorruptedCell(of_base=True), (joint,), rows, f"base of {where}")
                for where, rows in readings.dithered(joint).items()
            )

    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the size of the error [N·m], or of the logarithm of the factor."""
        return self.calibrated if self.of_base else self.SIZE * float(data.unit[h.rows[0]])

    def torque(self, data: TableData, h: Hypothesis) -> Array | None:
        """Return the error of the reading."""
        return None if self.of_base else np.ones(1)

    def level(self, data: TableData, h: Hypothesis, x: float) -> Array | float | None:
        """Return the logarithm of the factor by which calibrated friction is off."""
        return x if self.of_base else None

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the signed error of the reading."""
        reading = data.readings.all[h.rows[0]]
        size = data.unit[h.rows[0]] * (np.exp(-x) - 1) if self.of_base else x
        return {self.parameter: float(reading.where.sign * size)}

    def what(self, values: Mapping[str, float]) -> str:
        """Return the error in words."""
        return f"a bad reading, {values[self.parameter]:+.3g} N·m off"

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that it is not a property of the arm."""
        return "a bad reading"
