"""The cut-off of the robot's command filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.gap.tables.causes.base import (
    OTHER_JOINTS,
    SAME_DAY,
    Hypothesis,
    SimulatedCause,
)
from stiction_envs.gap.tables.readings import Readings, TableData
from stiction_envs.gap.tables.whole_arm import Quantity


class LowPass(SimulatedCause):
    """One cut-off for the dither of all joints."""

    name, parameter = "low_pass", "cutoff_hz"
    quantity = Quantity(
        name="low_pass", fields=("lowpass_hz",), of_interface=True, low=8.0, high=1000.0
    )
    """Range [Hz] is assumed."""
    log_size = 0.7
    tell_apart: ClassVar[Mapping[str, str]] = {
        "rotor_inertia": OTHER_JOINTS,
        "presliding": OTHER_JOINTS,
        "base_drift": SAME_DAY,
    }

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield one hypothesis for all joints."""
        yield Hypothesis(self, tuple(readings.joints), tuple(range(len(readings.all))))

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the cut-off."""
        return {self.parameter: float(np.exp(x)) * data.neutral(self.quantity)}

    def what(self, values: Mapping[str, float]) -> str:
        """Return the cut-off in words."""
        return f"a cut-off of {values['cutoff_hz']:.3g} Hz"

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that the filter belongs to the interface."""
        cutoff = values["cutoff_hz"]
        return f"a low-pass of {cutoff:.4g} Hz on the commanded torque is the interface's"
