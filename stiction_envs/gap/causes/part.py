"""A part of a model: one cause on one joint, with the numbers that were found for it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Part:
    """One cause on one joint, as it was found; a table ``[[cause]]`` of ``model.toml``."""

    cause: str
    """Name of the cause; ``name`` in the file."""
    joint: int
    """From 1; 0 is the whole arm."""
    shape: tuple[float, ...]
    """Nonlinear parameters."""
    coefficients: tuple[float, ...]
    """What its columns are multiplied by."""
    level: int = 1
    """Number of the diagnosis, from 1: a later one builds on the earlier ones."""
    carried: bool = False
    """Whether it was found with the gears carrying what the same diagnosis found on them; for a
    torque shift, whether it shifts all torques of that diagnosis."""

    @property
    def where(self) -> str:
        """``the arm`` or ``joint 3``."""
        return "the arm" if self.joint == 0 else f"joint {self.joint}"
