"""Position servos of an arm's joints, as a friction TOML has them in its table ``[servo]``.

`stiction diagnose` writes that table of servo logs.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.robots.tables import read_toml

LONGEST_DELAY = 1.0
"""Longest delay of a command that is simulated [s]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionServos:
    """Position servos of one arm's joints."""

    stiffness: Array
    """(n,) K [N·m/rad]."""
    delay: Array
    """(n,) time until a command acts [s]; a negative one, of a log's clock, counts as none."""
    speed_limit: Array
    """(n,) largest speed of what the servo follows [rad/s]."""
    torque_limit: Array
    """(n,) [N·m]."""
    dead_zone: Array
    """(n,) error that the servo does not see [rad]."""

    def __post_init__(self) -> None:
        low = {"delay": -np.inf, "dead_zone": 0.0}
        for field in fields(self):
            value = np.array(getattr(self, field.name), dtype=np.float64)
            least = low.get(field.name)
            ok = np.isfinite(value) & (value > 0 if least is None else value >= least)
            if value.ndim != 1 or not ok.all() or (field.name == "delay" and (value > 1).any()):
                expected = {"delay": f"up to {LONGEST_DELAY:g} s", "dead_zone": "from 0"}
                raise StictionError(
                    f"servo {field.name} {value.tolist()}: expected numbers "
                    f"{expected.get(field.name, 'above 0')}, one per joint"
                )
            value.flags.writeable = False
            object.__setattr__(self, field.name, value)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.stiffness)


def read_servos(path: str | Path, n: int) -> PositionServos | None:
    """Return the servos of n joints in a friction TOML; None where it has no ``[servo]``.

    Raises:
        StictionError: unreadable, or a table that is not of n servos.
    """
    table = read_toml(Path(path)).get("servo")
    if table is None:
        return None
    names = [f.name for f in fields(PositionServos)]
    if missing := [x for x in names if not isinstance(table, dict) or x not in table]:
        raise StictionError(f"{path}: [servo] {missing[0]} is missing")
    where = f"{path}: [servo]"
    try:
        return PositionServos(
            **{name: checked_array(table[name], f"{where} {name}", (n,)) for name in names}
        )
    except StictionError as error:
        text = str(error)
        raise StictionError(text if text.startswith(where) else f"{path}: {text}") from None
