"""The causes of torque tables, one module each; one line here registers a cause of the package.

A package of somebody else's adds one by `register`; `base.TableCause` says how.
"""

from __future__ import annotations

from stiction_envs.errors import StictionError
from stiction_envs.gap.tables.causes.base import Hypothesis, SimulatedCause, TableCause
from stiction_envs.gap.tables.causes.base_drift import BaseDrift
from stiction_envs.gap.tables.causes.corrupted_cell import CorruptedCell
from stiction_envs.gap.tables.causes.direction_asymmetry import DirectionAsymmetry
from stiction_envs.gap.tables.causes.friction_level import FrictionLevel
from stiction_envs.gap.tables.causes.gravity_error import GravityError
from stiction_envs.gap.tables.causes.low_pass import LowPass
from stiction_envs.gap.tables.causes.presliding import Presliding
from stiction_envs.gap.tables.causes.rotor_inertia import RotorInertia
from stiction_envs.gap.tables.causes.torque_offset import TorqueOffset

_CAUSES: dict[str, TableCause] = {}
ANYTHING_ELSE = "dithered torques at other frequencies and amplitudes"


def register(cause: TableCause) -> TableCause:
    """Add a cause; from then on diagnoses of torque tables try it.

    Raises:
        StictionError: a name that is taken.
    """
    if cause.name in _CAUSES:
        raise StictionError(f"cause {cause.name}: expected a name that is not taken")
    _CAUSES[cause.name] = cause
    return cause


def unregister(name: str) -> None:
    """Take a cause out again.

    Raises:
        StictionError: there is none of that name.
    """
    cause_named(name)
    del _CAUSES[name]


def registered() -> tuple[TableCause, ...]:
    """Return all causes."""
    return tuple(_CAUSES.values())


def cause_named(name: str) -> TableCause:
    """Return the cause of a name.

    Raises:
        StictionError: there is none.
    """
    if name not in _CAUSES:
        raise StictionError(f"unknown cause {name!r}: expected one of {', '.join(_CAUSES)}")
    return _CAUSES[name]


def what_tells_apart(one: str, other: str) -> str:
    """Return the measurement that tells two causes apart."""
    first, second = cause_named(one).tell_apart, cause_named(other).tell_apart
    return first.get(other) or second.get(one) or ANYTHING_ELSE


for _cause in (
    LowPass,
    RotorInertia,
    Presliding,
    TorqueOffset,
    GravityError,
    DirectionAsymmetry,
    FrictionLevel,
    BaseDrift,
    CorruptedCell,
):
    register(_cause())

__all__ = [
    "Hypothesis",
    "SimulatedCause",
    "TableCause",
    "cause_named",
    "register",
    "registered",
    "unregister",
    "what_tells_apart",
]
