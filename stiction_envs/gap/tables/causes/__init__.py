"""The causes that torque tables alone show, a class each; one line here registers a cause.

`torque_offset` and `direction_asymmetry`, which logs show too, are in `gap.causes`. Other packages
add a cause by `register`; `gap.causes.base.Cause` says how, and `SimulatedCause` does most of it.
"""

from __future__ import annotations

from functools import partial

from stiction_envs.gap.causes import register, unregister
from stiction_envs.gap.causes import registry as _registry
from stiction_envs.gap.tables.causes import direct, simulated
from stiction_envs.gap.tables.causes.simulated import SimulatedCause

registered = partial(_registry.registered, _registry.IN_TABLES)
cause_named = partial(_registry.cause_named, method=_registry.IN_TABLES)
ANYTHING_ELSE = "dithered torques at other frequencies and amplitudes"


def what_tells_apart(one: str, other: str) -> str:
    """Return the measurement that tells two causes apart; either of the two names it."""
    first, second = cause_named(one).tell_apart, cause_named(other).tell_apart
    return first.get(other) or second.get(one) or ANYTHING_ELSE


for _cause in (
    *(simulated.LowPass, simulated.RotorInertia, simulated.Presliding),
    *(direct.GravityError, direct.FrictionLevel, direct.BaseDrift, direct.CorruptedCell),
):
    register(_cause())

__all__ = [
    "SimulatedCause",
    "cause_named",
    "register",
    "registered",
    "unregister",
    "what_tells_apart",
]
