"""Causes by name: those of the package, and those that others register."""

import re

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import ALL_LINKS, Cause

IN_LOGS, IN_TABLES, IN_SERVO = "columns", "in_tables", "servo"
"""The member by which a cause says what joint logs, torque tables, and servo logs show of it."""
_IN_LOGS = "what", "what_to_record", "parameters"
_CAUSES: dict[str, Cause] = {}


def _shown(cause: Cause, method: str) -> bool:
    return getattr(type(cause), method) is not getattr(Cause, method)


def register(cause: Cause) -> Cause:
    """Add a cause; from then on diagnoses, model files and reports know it by its name.

    Raises:
        StictionError: a taken or improper name, a missing field, or nothing that shows it.
    """
    if not any(_shown(cause, method) for method in (IN_LOGS, IN_TABLES, IN_SERVO)):
        raise StictionError(
            f"cause {type(cause).__name__}: expected {IN_LOGS}, {IN_TABLES} or {IN_SERVO}, which "
            "show it"
        )
    for field in ("name", *(_IN_LOGS if _shown(cause, IN_LOGS) else ())):
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
    """Remove a cause.

    Raises:
        StictionError: there is none of that name.
    """
    if name not in _CAUSES:
        raise StictionError(f"unknown cause {name!r}: expected one of {', '.join(_CAUSES)}")
    del _CAUSES[name]


def registered(method: str = IN_LOGS) -> tuple[Cause, ...]:
    """Return all causes that can be named, those of the package first, in their order.

    ``method`` is `IN_LOGS`, `IN_TABLES` or `IN_SERVO`.
    """
    return tuple(c for c in _CAUSES.values() if _shown(c, method) and c.adds_to != ALL_LINKS)


def cause_named(name: str, method: str = IN_LOGS) -> Cause:
    """Return the cause of a name that logs, tables or servo logs show.

    Raises:
        StictionError: there is none.
    """
    known = {c.name: c for c in _CAUSES.values() if _shown(c, method)}
    if name not in known:
        raise StictionError(f"unknown cause {name!r}: expected one of {', '.join(known)}")
    return known[name]


def parameter_units() -> dict[str, str]:
    """Return the unit of every parameter of ``diagnosis.json`` that has one."""
    return {p.name: p.unit for c in registered() for p in c.parameters if p.unit != "1"}
