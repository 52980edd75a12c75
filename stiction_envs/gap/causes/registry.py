"""Causes by name: those of the package, and those that others register."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import ALL_LINKS, Cause


class _Named(Protocol):
    @property
    def name(self) -> str: ...


C = TypeVar("C", bound=_Named)


class Registry(Generic[C]):
    """Causes of one kind by name, in the order in which they were registered."""

    def __init__(self, needed: Sequence[str]) -> None:
        """Start without causes; ``needed`` are the fields that each must have."""
        self._needed = needed
        self._causes: dict[str, C] = {}

    def register(self, cause: C) -> C:
        """Add a cause; from then on diagnoses, model files and reports know it by its name.

        Raises:
            StictionError: a taken or improper name, or a missing field.
        """
        for field in self._needed:
            if not getattr(cause, field, None):
                raise StictionError(f"cause {type(cause).__name__}: no {field}: expected one")
        if not re.fullmatch(r"[a-z][a-z0-9_]*", cause.name):
            raise StictionError(
                f"cause {cause.name!r}: expected a name of small letters, digits and underscores"
            )
        if cause.name in self._causes:
            raise StictionError(f"cause {cause.name}: expected a name that is not taken")
        self._causes[cause.name] = cause
        return cause

    def unregister(self, name: str) -> None:
        """Remove a cause.

        Raises:
            StictionError: there is none of that name.
        """
        self.named(name)
        del self._causes[name]

    def registered(self) -> tuple[C, ...]:
        """Return all that can be named, those of the package first, in the contract's order."""
        return tuple(c for c in self._causes.values() if getattr(c, "adds_to", "") != ALL_LINKS)

    def named(self, name: str) -> C:
        """Return the cause of a name.

        Raises:
            StictionError: there is none.
        """
        if name not in self._causes:
            raise StictionError(
                f"unknown cause {name!r}: expected one of {', '.join(self._causes)}"
            )
        return self._causes[name]


_LOGS = Registry[Cause](("name", "what", "what_to_record", "parameters"))
register, unregister = _LOGS.register, _LOGS.unregister
registered, cause_named = _LOGS.registered, _LOGS.named


def parameter_units() -> dict[str, str]:
    """Return the unit of every parameter of ``diagnosis.json`` that has one."""
    return {p.name: p.unit for c in registered() for p in c.parameters if p.unit != "1"}
