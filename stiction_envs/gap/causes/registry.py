"""All causes by name: those of the package, and what others add to them."""

from __future__ import annotations

import re

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import Cause

_CAUSES: dict[str, Cause] = {}


def register(cause: Cause) -> Cause:
    """Add a cause; from then on `diagnose`, model files and reports know it by its name.

    Raises:
        StictionError: a name that is taken or no name, or something that every cause has missing.
    """
    for field in ("name", "what", "what_to_record", "parameters"):
        if not getattr(cause, field, None):
            raise StictionError(f"cause {type(cause).__name__}: no {field}: expected one")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", cause.name):
        raise StictionError(
            f"cause {cause.name!r}: expected a name of small letters, digits and underscores"
        )
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


def registered() -> tuple[Cause, ...]:
    """Return all causes, those of the contract first and in its order."""
    return tuple(_CAUSES.values())


def parameter_units() -> dict[str, str]:
    """Return the unit of every parameter of ``diagnosis.json`` that has one."""
    return {p.name: p.unit for c in registered() for p in c.parameters if p.unit != "1"}


def cause_named(name: str) -> Cause:
    """Return the cause of a name.

    Raises:
        StictionError: there is none.
    """
    if name not in _CAUSES:
        raise StictionError(f"unknown cause {name!r}: expected one of {', '.join(_CAUSES)}")
    return _CAUSES[name]
