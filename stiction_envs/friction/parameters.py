"""Friction parameters of an arm: one TOML, every number with a source or `assumed`."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.reporting.toml import toml_text
from stiction_envs.robots.arm_toml import Table, check_range, read_toml
from stiction_envs.robots.registry import ARMS

CONTROL_DT = 1e-3  # Control step, and longest physics step [s]
GENERIC = Path(__file__).with_name("generic.toml")
"""Friction of an arm without parameters of its own; all assumed."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity of the table: its unit, bounds, and whether it differs by direction."""

    unit: str
    low: float
    high: float = np.inf
    by_direction: bool = False
    default: float | None = None  # Where a TOML lacks the table; None where it must not


OTHER_TABLES = {"meta", "provenance", "arm", "cause", "links", "servo"}
"""Tables that are not quantities; the last four are in a `model.toml` of `stiction diagnose`."""


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Friction of the n joints of one arm, or of N arms.

    Every field is a read-only float64 array of shape (n,) or (N, n), with a last axis of
    2 (direction +, −) where `QUANTITIES` says so. SI units. Stiction at transmitted torque L:
    ``stiction + load_coefficient * clip(L, load_low, load_high)``; Coulomb is
    ``coulomb_ratio`` times that. ``offset + gravity_error * G`` is a torque, not a friction:
    the arm's sensor bias and gravity-model error, with G the signed gravity torque.
    """

    stiction: Annotated[Array, Quantity(unit="N·m", low=1e-6, by_direction=True)]
    """Stiction F_s at zero transmitted torque, per direction [N·m]."""
    coulomb_ratio: Annotated[Array, Quantity(unit="1", low=1e-3, high=1.0, by_direction=True)]
    """F_c / F_s per direction [-]."""
    stribeck_velocity: Annotated[Array, Quantity(unit="rad/s", low=1e-6, by_direction=True)]
    """v_s per direction [rad/s]."""
    viscous: Annotated[Array, Quantity(unit="N·m·s/rad", low=0.0, by_direction=True)]
    """σ2 per direction [N·m·s/rad]."""
    load_coefficient: Annotated[Array, Quantity(unit="1", low=-np.inf, default=0.0)]
    """Growth of stiction per N·m of transmitted torque [-]."""
    load_low: Annotated[Array, Quantity(unit="N·m", low=0.0, default=0.0)]
    """Load below which friction no longer changes [N·m]: the least load it was measured at."""
    load_high: Annotated[Array, Quantity(unit="N·m", low=0.0, default=np.inf)]
    """Load above which friction no longer changes [N·m]."""
    bristle_stiffness: Annotated[Array, Quantity(unit="N·m/rad", low=1e-3)]
    """σ0 [N·m/rad]."""
    bristle_damping_ratio: Annotated[Array, Quantity(unit="1", low=0.0, default=0.4)]
    """ζ of σ1 = 2ζ√(σ0 J) [-]."""
    rotor_inertia: Annotated[Array, Quantity(unit="kg·m²", low=0.0)]
    """Apparent rotor inertia at the joint [kg·m²]."""
    joint_stiffness: Annotated[Array, Quantity(unit="N·m/rad", low=1.0, default=np.inf)]
    """Spring between rotor and link [N·m/rad]; inf is a rigid joint."""
    joint_damping_ratio: Annotated[Array, Quantity(unit="1", low=0.0, default=0.15)]
    """ζ of that spring's damping 2ζ√(K J_rotor) [-]."""
    ripple_amplitude: Annotated[Array, Quantity(unit="N·m", low=0.0, default=0.0)]
    """A of the position ripple A sin(Nq + φ) [N·m]."""
    ripple_periods: Annotated[Array, Quantity(unit="1/rev", low=0.0, default=1.0)]
    """N, ripple periods per turn of the joint [-]."""
    ripple_phase: Annotated[Array, Quantity(unit="rad", low=-np.inf, default=0.0)]
    """φ [rad]."""
    warm_up_friction: Annotated[Array, Quantity(unit="1", low=-0.9, default=0.0)]
    """Relative rise of the dry friction of the cold joint: factor 1 + w e^(−t/T) [-]."""
    warm_up_viscous: Annotated[Array, Quantity(unit="1", low=-0.9, default=0.0)]
    """Relative rise of the viscous friction of the cold joint [-]."""
    warm_up_time: Annotated[Array, Quantity(unit="s", low=1e-3, default=1200.0)]
    """T [s]."""
    offset: Annotated[Array, Quantity(unit="N·m", low=-np.inf, default=0.0)]
    """Constant torque bias [N·m]."""
    gravity_error: Annotated[Array, Quantity(unit="1", low=-np.inf, default=0.0)]
    """Gravity compensation error over gravity torque [-]."""

    def __post_init__(self) -> None:
        for name, quantity in QUANTITIES.items():
            value = checked_array(
                *(getattr(self, name), f"friction parameter {name}"),
                finite=False,
                low=quantity.low,
                high=quantity.high,
                unit=quantity.unit,
            )
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.rotor_inertia.shape[-1]

    @property
    def elastic(self) -> Bools:
        """(n,) which joints have a spring between rotor and link."""
        finite: Bools = np.isfinite(self.joint_stiffness)
        return finite if finite.ndim == 1 else finite[0]

    @property
    def asymmetric(self) -> bool:
        """True if a friction level depends on direction: the plant writes it every control step."""
        names = [k for k, q in QUANTITIES.items() if q.by_direction]
        return any(bool(np.any(a[..., 0] != a[..., 1])) for a in (getattr(self, k) for k in names))

    def replace(self, **changes: Array) -> "FrictionParameters":
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)

    def tile(self, nsim: int) -> "FrictionParameters":
        """Return the parameters of ``nsim`` equal arms, (nsim, n)."""
        fields = {k: getattr(self, k) for k in QUANTITIES}
        tiled = {k: np.broadcast_to(x, (nsim, *x.shape)) for k, x in fields.items()}
        return FrictionParameters(**tiled)

    def rigid(self) -> "FrictionParameters":
        """Return the same friction on joints without elasticity."""
        return self.replace(joint_stiffness=np.full_like(self.joint_stiffness, np.inf))

    def stiction_at(self, load: Array) -> Array:
        """Return (..., n, 2) F_s [N·m] under transmitted torque ``load`` (..., n) [N·m]."""
        clipped = np.clip(load, self.load_low, self.load_high)
        level = self.stiction + (self.load_coefficient * clipped)[..., None]
        # A fitted coefficient may be negative, friction may not; the factor is assumed.
        return np.maximum(level, 1e-3 * self.stiction)


QUANTITIES: dict[str, Quantity] = {
    name: kind.__metadata__[0]
    for name, kind in get_type_hints(FrictionParameters, include_extras=True).items()
}
"""By the name of the field; bounds are those of any joint, not of a plausible one (assumed)."""


def stack_friction(arms: Sequence[FrictionParameters]) -> FrictionParameters:
    """Return the friction (N, n) of N arms, each of its own (n,)."""
    return FrictionParameters(**{k: np.stack([getattr(a, k) for a in arms]) for k in QUANTITIES})


def scaled(parameters: FrictionParameters, factors: Mapping[str, ArrayLike]) -> FrictionParameters:
    """Return friction (n,) or (N, n) with quantities multiplied, both directions alike.

    ``factors`` [-] are by name of `QUANTITIES` a number, (n,), or (N, n). Raise a StictionError for
    an unknown name, another shape, or a product out of bounds.
    """
    changes = {}
    for name, factor in factors.items():
        if name not in QUANTITIES:
            raise unknown("friction parameter", name, QUANTITIES)
        value, shape = getattr(parameters, name), parameters.rotor_inertia.shape
        by_joint = checked_array(factor, f"factor of {name}", shape, fill=True)
        changes[name] = value * (by_joint[..., None] if value.ndim > by_joint.ndim else by_joint)
    return parameters.replace(**changes)


def bristle_damping(
    stiffness: Array, damping_ratio: Array, inertia: Array, timestep: float
) -> Array:
    """Return σ1 = max(2ζ√(σ0 J), 3 h σ0) [N·m·s/rad]: sources.md 3.5, 5.1."""
    return np.maximum(2 * damping_ratio * np.sqrt(stiffness * inertia), 3 * timestep * stiffness)


def check_stability(damping: Array, inertia: Array, timestep: float) -> None:
    """Raise if a stuck joint would chatter in MuJoCo's Euler, hσ1/J ≥ 2: sources.md 3.5.

    ``damping`` σ1 [N·m·s/rad] and ``inertia`` J [kg·m²] are (n,) or (N, n), ``timestep`` is h [s].
    """
    # written so that an inertia of zero or less fails too
    hard = ~(timestep * damping < 2 * inertia)
    if hard.any():
        at = tuple(np.argwhere(hard)[0])
        raise StictionError(
            f"joint {at[-1] + 1}: h·damping = {timestep * damping[at]:.3g} kg·m² at h = {timestep} "
            f"s must stay under twice the inertia {inertia[at]:.3g} kg·m²: use a smaller step, "
            f"softer bristles or more inertia"
        )


def from_table(table: Mapping[str, object], where: str, n: int) -> FrictionParameters:
    """Build parameters from parsed TOML; ``where`` names the file in errors."""
    if extra := sorted(set(table) - set(QUANTITIES) - OTHER_TABLES):
        raise StictionError(
            f"{where}: unknown table [{extra[0]}]: expected one of {', '.join(QUANTITIES)}"
        )
    values: dict[str, Array] = {}
    for name, quantity in QUANTITIES.items():
        usual = None if quantity.default is None else {"value": quantity.default, "assumed": True}
        entry = table.get(name, usual)
        if entry is None:
            raise StictionError(f"{where}: table [{name}] is missing")
        has_source = isinstance(entry, dict) and bool({"source", "assumed"} & set(entry))
        if not isinstance(entry, dict) or not has_source or "value" not in entry:
            raise StictionError(f"{where}: [{name}] needs value and source (or assumed)")
        what, shape = f"{where}: [{name}] value", (n, 2) if quantity.by_direction else (n,)
        value = checked_array(entry["value"], what, finite=False)
        if quantity.by_direction and value.ndim == 1:
            value = value[:, None]
        values[name] = checked_array(value, what, shape, fill=True, finite=False)
    try:
        out = FrictionParameters(**values)
    except StictionError as error:
        raise StictionError(f"{where}: {error}") from None
    check_possible(out, where)
    return out


def check_possible(parameters: FrictionParameters, where: str) -> None:
    """Raise a StictionError if a number is larger than any joint's; ``where`` names the file."""
    for name, quantity in QUANTITIES.items():
        value, inf = getattr(parameters, name), quantity.default == np.inf
        check_range(value, quantity.unit, f"{where}: [{name}]", allow_inf=inf)


def friction_path(robot: str | Path | None) -> Path:
    """Return the TOML of a robot's name, or the path itself; `generic.toml` for unknown arms."""
    if robot is not None and Path(robot).suffix == ".toml":
        return Path(robot)
    known = ARMS.get(str(robot))
    return known.friction if known is not None and known.friction.exists() else GENERIC


def friction_sources(given: str | Path | FrictionParameters | None) -> tuple[dict[str, str], Table]:
    """Return the source of each quantity of a friction, and the ``[meta]`` of its TOML.

    ``given`` is a robot or TOML as in `load_friction`, or parameters, of which those that are equal
    to `generic.toml` are assumed.
    """
    if isinstance(given, FrictionParameters):
        sources, generic = friction_sources(GENERIC)[0], load_friction(GENERIC, given.n)
        for k in QUANTITIES:
            if not np.array_equal(getattr(given, k), getattr(generic, k)):
                sources[k] = "the robot's file, or parameters in memory"
        return sources, {}
    path = friction_path(given)
    table = read_toml(path)
    sources = {
        k: str(table[k].get("source", "assumed")) if k in table else f"assumed: not in {path.name}"
        for k in QUANTITIES
    }
    return sources, table.get("meta", {})


def load_friction(robot: str | Path | None, n: int = 7) -> FrictionParameters:
    """Load the friction of a robot by name or TOML path; None is an unknown arm.

    An arm without its own TOML gets the first n joints of `generic.toml` (all assumed). Raise a
    StictionError for an unreadable file, missing table, wrong shape, or value out of bounds.
    """
    path = friction_path(robot)
    table = read_toml(path)
    if path == GENERIC:
        for entry in table.values():
            if isinstance(entry.get("value"), list):
                entry["value"] = entry["value"][:n]
    return from_table(table, path.name, n)


def dump_friction(
    parameters: FrictionParameters,
    *,
    sources: dict[str, str],
    meta: Mapping[str, object],
    provenance: dict[str, str],
) -> str:
    """Return the TOML text of one arm's parameters (n,) or (n, 2); floats read back exactly.

    A source of ``sources``, by quantity, that starts with "assumed" is marked as assumed.
    """
    table: Table = {"meta": meta, "provenance": provenance}
    for name, quantity in QUANTITIES.items():
        value: Array = getattr(parameters, name)
        if quantity.by_direction and np.array_equal(value[:, 0], value[:, 1]):
            value = value[:, 0]
        source = sources[name]
        table[name] = {"value": value.tolist(), "unit": quantity.unit, "source": source}
        if source.startswith("assumed"):
            table[name]["assumed"] = True
    head = "Joint friction. SI units; direction order is +, −. Written by calibration."
    return toml_text(table, head=head)
