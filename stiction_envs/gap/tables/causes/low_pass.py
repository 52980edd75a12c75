"""The cut-off of the robot's command filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from stiction_envs.gap.tables.causes.base import (
    OTHER_JOINTS,
    SAME_DAY,
    Hypothesis,
    SimulatedCause,
    Wheres,
)
from stiction_envs.gap.tables.whole_arm import Quantity


class LowPass(SimulatedCause):
    """One cut-off for the dither of all joints."""

    name, parameter, units = "low_pass", "cutoff_hz", {"cutoff_hz": "Hz"}
    quantity = Quantity(
        name="low_pass",
        fields=("lowpass_hz",),
        of_interface=True,
        low=8.0,
        high=1000.0,
        anchors=(0.4, 2.5),
    )
    """Range [Hz] and anchors [-] are assumed."""
    tell_apart: ClassVar[Mapping[str, str]] = {
        "rotor_inertia": OTHER_JOINTS,
        "presliding": OTHER_JOINTS,
        "base_drift": SAME_DAY,
    }

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield one hypothesis for all joints."""
        yield Hypothesis(self, tuple(w for some in wheres.values() for w in some))

    def changed_to(self, value: float) -> str:
        """Return the cut-off in words."""
        return f"a cut-off of {value:.3g} Hz"

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that the filter belongs to the interface."""
        cutoff = values["cutoff_hz"]
        return f"a low-pass of {cutoff:.4g} Hz on the commanded torque is the interface's"
