"""The bristle stiffness of a joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from stiction_envs.gap.tables.causes.simulated import SAME_DAY, SimulatedCause
from stiction_envs.gap.tables.whole_arm import Quantity


class Presliding(SimulatedCause):
    """Dithered torques are off where dither is near √(σ0/J)/2π."""

    name, absolute = "presliding", "bristle_stiffness"
    quantity = Quantity(name="presliding", fields=("bristle_stiffness",), low=0.1, high=10.0)
    """Range is assumed."""
    log_size = 0.7
    tell_apart: ClassVar[Mapping[str, str]] = {"base_drift": SAME_DAY, "friction_level": SAME_DAY}
