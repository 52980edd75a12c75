"""Parameters of one joint under a position servo, and the causes to which they belong.

    u = clip(K (r − q), ±limit)                servo; r: the command, late and rate-limited
    (M + A) q̈ = u − d q̇ − τ_f − (g(q) − b) − τ_c      joint; τ_c: torque of the other joints' motion
    τ_f: LuGre with level (F_s + μ |g|)(1 − s + s exp(−(q̇/v_s)²))            friction

The log shows q + offset. A dead zone is taken off the error K multiplies. Their names, bounds and
steps are in ``servo_parameters.toml``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FAR = 1e6
"""Value of a limit that is never reached [SI]."""


@dataclass(frozen=True, kw_only=True)
class ServoParameter:
    """One parameter of a joint."""

    cause: str
    """The cause to which it belongs."""
    key: str
    """Name of the parameter in ``diagnosis.json``."""
    unit: str
    low: float
    high: float
    absent: float
    """The value at which it has no effect."""
    size: float
    """Usual size of its change where its cause is present: the standard deviation of its prior."""
    scale: Literal["unit", "stiffness", "ratio"] = "unit"
    """Whether that is in its own unit, times the servo's stiffness, or of its logarithm."""


_FILE = Path(__file__).with_name("servo_parameters.toml")
PARAMETERS = msgspec.toml.decode(_FILE.read_bytes(), type=dict[str, ServoParameter])
NAMES = tuple(PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
LOW = np.array([p.low for p in PARAMETERS.values()])
HIGH = np.array([p.high for p in PARAMETERS.values()])


def absent() -> Array:
    """Return (P,) parameters of a joint without friction, lag and limits; stiffness is NaN."""
    return np.array([p.absent for p in PARAMETERS.values()])


def of_cause(cause: str) -> tuple[str, ...]:
    """Return the parameters of a cause."""
    return tuple(name for name, p in PARAMETERS.items() if p.cause == cause)
