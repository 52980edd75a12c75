"""Constant settings of a Cartesian impedance controller, and its stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.errors import StictionError, checked_array
from stiction_envs.robots.tables import Table, read_toml

GTE_DEFAULTS: dict[str, Table] = {
    table: {name: entry["value"] for name, entry in entries.items()}
    for table, entries in read_toml(Path(__file__).with_name("gte.toml")).items()
}
"""Values of ``gte.toml``, which has their sources, by table and name."""
_DEFAULT = GTE_DEFAULTS["impedance"]
_BOUNDS: dict[str, tuple[tuple[int, ...] | None, float, float]] = {
    "translational_stiffness": ((3,), -np.inf, np.inf),
    "rotational_stiffness": ((3,), -np.inf, np.inf),
    "nullspace_stiffness": (None, -np.inf, np.inf),
    "damping_ratio": ((6,), -np.inf, 1.0),
    "nullspace_damping_ratio": ((), -np.inf, 1.0),
    "limit_margin": ((), -np.inf, np.inf),
    **dict.fromkeys(
        ("pseudoinverse_damping", "rate_hz", "singular_below", "singular_length", "torque_rate"),
        ((), 0.0, np.inf),
    ),
    "pose_filter": ((), 0.0, 1.0),
}
"""Shape of each number (None: any), what it is above, and the most that it may be."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpedanceSettings:
    """Constant settings of the controller; defaults and their sources are in ``gte.toml``."""

    translational_stiffness: ArrayLike = _DEFAULT["translational_stiffness"]
    """K_t, one number or (3,) in the base frame [N/m]."""
    rotational_stiffness: ArrayLike = _DEFAULT["rotational_stiffness"]
    """K_r, one number or (3,) about the base frame's axes [N·m/rad]."""
    nullspace_stiffness: ArrayLike = _DEFAULT["nullspace_stiffness"]
    """k_n, one number or (n,) [N·m/rad]; 0 means no nullspace torque."""
    damping_ratio: ArrayLike = _DEFAULT["damping_ratio"]
    """ξ, one number or (6,), in [0, 1] [-]."""
    nullspace_damping_ratio: float = _DEFAULT["nullspace_damping_ratio"]
    """ξ_n of d_n = 2 ξ_n √k_n, in [0, 1] [-]. It contains no mass: critical in number only."""
    pseudoinverse_damping: float = _DEFAULT["pseudoinverse_damping"]
    """λ of the J^# of a feedforward compensation, singular values σ/(σ² + λ²) [m and rad]."""
    rate_hz: float = _DEFAULT["rate_hz"]
    """Cycles per second [Hz]."""
    torque_rate: float = _DEFAULT["torque_rate"]
    """Largest change of a joint's command per cycle [N·m]; inf is off."""
    pose_filter: float = _DEFAULT["pose_filter"]
    """p, fraction of a change of the reference pose that is reached after one second, in (0, 1];
    1 is off."""
    dither_after_saturation: bool = _DEFAULT["dither_after_saturation"]
    """False: dither counts towards ``torque_rate``; True: it is added after that limit."""
    singular_below: float = _DEFAULT["singular_below"]
    """Smallest eigenvalue of the scaled J M⁻¹ Jᵀ that is still regular, s_0 [1/kg]."""
    singular_length: float = _DEFAULT["singular_length"]
    """ℓ: a rotation of 1 rad counts as this translation there [m]."""
    limit_margin: float = _DEFAULT["limit_margin"]
    """Distance from a joint limit that counts as near [rad]."""

    def __post_init__(self) -> None:
        for name, (shape, above, most) in _BOUNDS.items():
            what, value = f"impedance {name.replace('_', ' ')}", getattr(self, name)
            array = checked_array(value, what, finite=False)
            bad = ~((array >= 0.0) & (array > above) & (array <= most))
            if name != "torque_rate":
                bad |= ~np.isfinite(array)
            if bad.any():
                low = ">= 0" if above < 0 else f"> {above:g}"
                high = "" if most == np.inf else f" and <= {most:g}"
                found = np.ravel(array[bad])[0]
                raise StictionError(f"{what} is {found}: expected finite numbers {low}{high}")
            if shape is not None:
                array = checked_array(array, what, shape, fill=bool(shape), finite=False)
            array.flags.writeable = False
            object.__setattr__(self, name, float(array) if shape == () else array)

    @property
    def filter_step(self) -> float:
        """The s of x ← x + s (target − x) of the pose; 1 is off (sources.md 6.1).

        s = 1/(κ f + 1) with κ = −1/ln(1 − p) reaches the fraction p in one second.
        """
        p = self.pose_filter
        return 1.0 if p == 1.0 else 1.0 / (1.0 - self.rate_hz / np.log1p(-p))
