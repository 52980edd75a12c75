"""The causes of torque tables, one module each; one line here registers a cause of the package.

Other packages add one by `register`; `base.TableCause` says how.
"""

from __future__ import annotations

from stiction_envs.gap.causes.registry import Registry
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

_TABLES = Registry[TableCause](("name",))
register, unregister = _TABLES.register, _TABLES.unregister
registered, cause_named = _TABLES.registered, _TABLES.named
ANYTHING_ELSE = "dithered torques at other frequencies and amplitudes"


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
