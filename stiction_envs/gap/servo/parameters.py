"""Parameters of one joint under a position servo, and the causes to which they belong.

    u = clip(K (r − q), ±limit)                servo; r: the command, late, low-passed, rate-limited
    (M + A) q̈ = u − d q̇ − τ_f − (g(q) − b) − τ_c      joint; τ_c: torque of the other joints' motion
    τ_f: LuGre with level (F_s + μ |g|)(1 − s + s exp(−(q̇/v_s)²))            friction

The log shows q + offset. A dead zone is taken off the error K multiplies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FAR = 1e6
"""Value of a limit that is never reached [SI]."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: bounds and steps are of the size that joints have, all assumed."""

    cause: str
    """The cause to which it belongs."""
    key: str
    """Its name in ``diagnosis.json``."""
    unit: str
    low: float
    high: float
    step: float
    """A small change of it, as seen by a joint; scales the fit."""
    absent: float
    """The value at which it has no effect."""
    starts: tuple[float, ...] = ()
    """Values from which a fit with it starts."""


PARAMETERS: dict[str, Parameter] = {
    "stiffness": Parameter(
        cause="servo_stiffness",
        key="stiffness_nm_per_rad",
        unit="N·m/rad",
        low=0.05,
        high=2000.0,
        step=3.0,
        absent=np.nan,
    ),
    "damping": Parameter(
        cause="damping",
        key="damping_nms",
        unit="N·m·s/rad",
        low=0.0,
        high=200.0,
        step=0.2,
        absent=0.0,
    ),
    "armature": Parameter(
        cause="armature",
        key="armature_kgm2",
        unit="kg·m²",
        low=0.0,
        high=5.0,
        step=0.02,
        absent=0.0,
    ),
    "delay": Parameter(
        cause="delay", key="delay_s", unit="s", low=-0.03, high=0.2, step=0.005, absent=0.0
    ),
    "stiction": Parameter(
        cause="coulomb_friction",
        key="coulomb_nm",
        unit="N·m",
        low=0.0,
        high=100.0,
        step=0.1,
        absent=0.0,
    ),
    "drop": Parameter(
        cause="stribeck_friction", key="drop", unit="1", low=0.0, high=0.95, step=0.2, absent=0.0
    ),
    "stribeck_velocity": Parameter(
        cause="stribeck_friction",
        key="stribeck_velocity",
        unit="rad/s",
        low=0.01,
        high=1.0,
        step=0.05,
        absent=0.1,
    ),
    "load": Parameter(
        cause="load_dependent_friction",
        key="load_coefficient",
        unit="1",
        low=0.0,
        high=1.5,
        step=0.1,
        absent=0.0,
    ),
    "bristle": Parameter(
        cause="presliding_hysteresis",
        key="presliding_rad",
        unit="rad",
        low=2e-4,
        high=0.06,
        step=2e-3,
        absent=1e-3,
    ),
    "torque_limit": Parameter(
        cause="torque_limit", key="limit_nm", unit="N·m", low=0.02, high=FAR, step=0.3, absent=FAR
    ),
    "speed_limit": Parameter(
        cause="speed_limit",
        key="limit_rad_s",
        unit="rad/s",
        low=0.05,
        high=FAR,
        step=0.3,
        absent=FAR,
    ),
    "dead_zone": Parameter(
        cause="dead_zone", key="width_rad", unit="rad", low=0.0, high=0.1, step=0.005, absent=0.0
    ),
    "offset": Parameter(
        cause="encoder_offset",
        key="offset_rad",
        unit="rad",
        low=-0.3,
        high=0.3,
        step=0.01,
        absent=0.0,
    ),
    "compensation": Parameter(
        cause="gravity_compensation_missing",
        key="share",
        unit="1",
        low=-0.2,
        high=1.2,
        step=0.2,
        absent=0.0,
    ),
}
NAMES = tuple(PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}


def absent() -> Array:
    """Return (P,) parameters of a joint without friction, lag and limits; stiffness is NaN."""
    return np.array([p.absent for p in PARAMETERS.values()])


def of_cause(cause: str) -> tuple[str, ...]:
    """Return the parameters of a cause."""
    return tuple(name for name, p in PARAMETERS.items() if p.cause == cause)
