"""The apparent rotor inertia of a joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from stiction_envs.gap.tables.causes.simulated import SAME_DAY, SimulatedCause
from stiction_envs.gap.tables.whole_arm import Quantity


class RotorInertia(SimulatedCause):
    """Dithered torques are off, most near resonance."""

    name, absolute = "rotor_inertia", "armature_kgm2"
    quantity = Quantity(name="rotor_inertia", fields=("rotor_inertia",), low=0.2, high=5.0)
    """Range is assumed."""
    tell_apart: ClassVar[Mapping[str, str]] = {
        "presliding": "dither well below the presliding resonance (half of √(σ0/J)/2π): there "
        "inertia plays no part",
        "base_drift": SAME_DAY,
        "friction_level": "the free joint shaken at 50 to 80 Hz above breakaway: its acceleration "
        "shows the inertia",
    }
