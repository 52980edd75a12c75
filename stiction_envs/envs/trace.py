"""What one episode did over time, kept to be drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class RampTrace:
    """Samples of one ramp of the SJE, one per block of control steps."""

    time: list[float] = field(default_factory=list)
    """Since the ramp started [s]."""
    torque: list[float] = field(default_factory=list)
    """Commanded torque of the tested joint, dither excluded [N·m]."""
    amplitude: list[float] = field(default_factory=list)
    """Dither amplitude of the tested joint [N·m]."""
    frequency: list[float] = field(default_factory=list)
    """Dither frequency of the tested joint [Hz]."""
    displacement: list[float] = field(default_factory=list)
    """Angle of the tested joint since its ramp started [rad]."""

    def clear(self) -> None:
        """Forget everything: a new episode starts."""
        for samples in vars(self).values():
            samples.clear()

    def add(self, **sample: float) -> None:
        """Append one sample: every field by name."""
        for name, value in sample.items():
            getattr(self, name).append(value)


@dataclass
class PathTrace:
    """One path of the GTE; lists of one array per step."""

    time: list[Array] = field(default_factory=list)
    """(S,) of the samples [s]."""
    error: list[Array] = field(default_factory=list)
    """(S, 6) [m, rad]."""
    position: list[Array] = field(default_factory=list)
    """(S, 3) of the flange [m]."""
    amplitude: list[Array] = field(default_factory=list)
    """(1, n) of the step's dither [N·m]."""
