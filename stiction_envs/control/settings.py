"""What a Cartesian impedance controller is told once, and the stiffness it is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.errors import StictionError, unknown
from stiction_envs.robots.tables import lookup, read_toml

Array = NDArray[np.float64]
DAMPING_DESIGNS = ("diagonal", "mass")
PROJECTORS = ("dynamic", "pseudoinverse")
FILTERS = ("stiffness_filter", "pose_filter", "nullspace_filter", "wrench_filter")
_POSITIVE = ("pseudoinverse_damping", "rate_hz", "singular_below", "singular_length")


@cache
def _table() -> dict[str, Any]:
    return read_toml(Path(__file__).with_name("gte.toml"))


def gte_default(key: str) -> Any:
    """Default of a dotted ``key`` of ``gte.toml``, which has the sources."""
    return lookup(_table(), key)


def _default(name: str) -> Callable[[], Any]:
    return partial(gte_default, f"impedance.{name}")


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpedanceSettings:
    """What the controller is told once; defaults and their sources are in ``gte.toml``.

    A filter is the fraction p of a change that is reached after one second: 1 is off, see
    :meth:`filter_step`.
    """

    translational_stiffness: ArrayLike = field(default_factory=_default("translational_stiffness"))
    """K_t, one number or (3,) in the base frame [N/m]."""
    rotational_stiffness: ArrayLike = field(default_factory=_default("rotational_stiffness"))
    """K_r, one number or (3,) about the base frame's axes [N·m/rad]."""
    coupling_stiffness: ArrayLike = field(default_factory=_default("coupling_stiffness"))
    """K_c of eq. 2.13, (3, 3) or 0 [N/rad]; the whole (6, 6) must be symmetric and ≥ 0."""
    nullspace_stiffness: ArrayLike = field(default_factory=_default("nullspace_stiffness"))
    """k_n, one number or (n,) [N·m/rad]; 0 is no nullspace torque at all."""
    damping_ratio: ArrayLike = field(default_factory=_default("damping_ratio"))
    """ξ, one number or (6,), in [0, 1] [-]."""
    nullspace_damping_ratio: float = field(default_factory=_default("nullspace_damping_ratio"))
    """ξ_n of d_n = 2 ξ_n √k_n, in [0, 1] [-]. No mass in it: critical by number only."""
    damping_design: str = field(default_factory=_default("damping_design"))
    """``diagonal``: D_ii = 2 ξ_i √K_ii, as the package; ``mass``: eq. 2.14, critical at ξ = 1."""
    projector: str = field(default_factory=_default("projector"))
    """P: ``dynamic``, eq. 2.17, or ``pseudoinverse``, I − Jᵀ(Jᵀ)^#, as the package."""
    pseudoinverse_damping: float = field(default_factory=_default("pseudoinverse_damping"))
    """λ of (Jᵀ)^#, singular values σ/(σ² + λ²) [m and rad]."""
    rate_hz: float = field(default_factory=_default("rate_hz"))
    """Cycles per second [Hz]."""
    torque_rate: float = field(default_factory=_default("torque_rate"))
    """Largest change of a joint's command per cycle [N·m]; inf is off."""
    stiffness_filter: float = field(default_factory=_default("stiffness_filter"))
    """p of the stiffness, Cartesian and nullspace, in (0, 1]."""
    pose_filter: float = field(default_factory=_default("pose_filter"))
    """p of the reference pose, in (0, 1]."""
    nullspace_filter: float = field(default_factory=_default("nullspace_filter"))
    """p of the nullspace configuration, in (0, 1]."""
    wrench_filter: float = field(default_factory=_default("wrench_filter"))
    """p of the external wrench, in (0, 1]."""
    coriolis: bool = field(default_factory=_default("coriolis"))
    """Whether C(q, q̇)q̇ is added; :meth:`CartesianImpedance.torque` then needs it."""
    dither_after_saturation: bool = field(default_factory=_default("dither_after_saturation"))
    """False: dither counts towards ``torque_rate``; True: it is added behind it."""
    singular_below: float = field(default_factory=_default("singular_below"))
    """Smallest eigenvalue of the scaled J M⁻¹ Jᵀ that is still regular, s_0 [1/kg]."""
    singular_length: float = field(default_factory=_default("singular_length"))
    """ℓ: a rotation of 1 rad counts as this translation there [m]."""
    limit_margin: float = field(default_factory=_default("limit_margin"))
    """Distance from a joint limit that counts as near [rad]."""

    def __post_init__(self) -> None:
        checks: dict[str, tuple[tuple[int, ...] | None, dict[str, float]]] = {
            "translational_stiffness": ((3,), {}),
            "rotational_stiffness": ((3,), {}),
            "coupling_stiffness": ((3, 3), {"low": -np.inf}),
            "nullspace_stiffness": (None, {}),
            "damping_ratio": ((6,), {"high": 1.0}),
            "nullspace_damping_ratio": ((), {"high": 1.0}),
            "limit_margin": ((), {}),
            **{name: ((), {"above": 0.0}) for name in _POSITIVE},
            **{name: ((), {"above": 0.0, "high": 1.0}) for name in FILTERS},
        }
        for name, (shape, bounds) in checks.items():
            what = name.replace("_", " ")
            array = numbers(what, getattr(self, name), **bounds)
            if shape is not None and array.shape not in ((), shape):
                raise StictionError(
                    f"impedance {what} has shape {array.shape}: expected "
                    + (f"one number or {shape}" if shape else "one number")
                )
            if shape == ():
                object.__setattr__(self, name, float(array))
            else:
                array = np.array(np.broadcast_to(array, shape or array.shape))
                array.flags.writeable = False
                object.__setattr__(self, name, array)
        if self.torque_rate != np.inf:
            numbers("torque rate", self.torque_rate, above=0.0)
        if self.damping_design not in DAMPING_DESIGNS:
            raise unknown("damping design", self.damping_design, DAMPING_DESIGNS)
        if self.projector not in PROJECTORS:
            raise unknown("projector", self.projector, PROJECTORS)
        stiffness_matrix(
            self.translational_stiffness, self.rotational_stiffness, self.coupling_stiffness
        )

    def filter_step(self, name: str) -> float:
        """Return s of x ← x + s (target − x) for one of the filters; 1 is off (physics.md 6.1).

        s = 1/(κ f + 1) with κ = −1/ln(1 − p) reaches the fraction p in one second.
        """
        p = getattr(self, name)
        return 1.0 if p == 1.0 else 1.0 / (1.0 - self.rate_hz / np.log1p(-p))


def stiffness_matrix(
    translational: ArrayLike, rotational: ArrayLike, coupling: ArrayLike = 0.0
) -> Array:
    """Cartesian stiffness (..., 6, 6) of eq. 2.13.

    Args:
        translational: (..., 3) diagonal of K_t [N/m].
        rotational: (..., 3) diagonal of K_r [N·m/rad].
        coupling: K_c, (..., 3, 3) or 0 [N/rad].

    Raises:
        StictionError: not symmetric, that is K_c is not, or not positive semidefinite.
    """
    t, r = np.asarray(translational, dtype=float), np.asarray(rotational, dtype=float)
    out = np.zeros((*t.shape[:-1], 6, 6))
    for k in range(3):
        out[..., k, k], out[..., 3 + k, 3 + k] = t[..., k], r[..., k]
    out[..., :3, 3:] = out[..., 3:, :3] = coupling
    if not np.array_equal(out, np.swapaxes(out, -1, -2)):
        raise StictionError("impedance stiffness: K_c is not symmetric: expected a symmetric one")
    eigenvalues = np.linalg.eigvalsh(out)
    low, high = float(eigenvalues[..., 0].min()), float(eigenvalues[..., -1].max())
    if low < -1e-9 * high:  # beyond rounding
        raise StictionError(
            f"impedance stiffness: smallest eigenvalue {low:.6g}: expected positive "
            "semidefinite matrices, so the coupling is too large for K_t and K_r"
        )
    return out


def numbers(
    name: str, value: Any, *, low: float = 0.0, above: float = -np.inf, high: float = np.inf
) -> Array:
    """Own array of finite numbers in [``low``, ``high``] and greater than ``above``.

    Raises:
        StictionError: it is not, naming what it is the ``name`` of and what was expected.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise StictionError(f"impedance {name} is {value!r}: expected finite numbers") from None
    good = np.isfinite(array) & (array >= low) & (array > above) & (array <= high)
    if not good.all():
        bounds = [f"> {above:g}" if above > -np.inf else f">= {low:g}" if low > -np.inf else ""]
        bounds.append(f"<= {high:g}" if high < np.inf else "")
        expected = " and ".join(["finite", *filter(None, bounds)])
        raise StictionError(f"impedance {name} is {np.ravel(array[~good])[0]}: expected {expected}")
    return array
