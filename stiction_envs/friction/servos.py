"""Position servos of an arm's joints, as a friction TOML has them in its table ``[servo]``.

`stiction diagnose` writes that table of servo logs.
"""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.robots.arm_toml import read_toml

LONGEST_DELAY = 1.0  # Longest delay of a command that is simulated [s]; assumed


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionServos:
    """Position servos of one arm's joints."""

    stiffness: Array  # (n,) K [N·m/rad]
    delay: Array
    """(n,) time until a command acts [s]; a negative one, of a log's clock, counts as none."""
    speed_limit: Array  # (n,) largest speed of what the servo follows [rad/s]
    torque_limit: Array  # (n,) [N·m]
    dead_zone: Array  # (n,) error that the servo does not see [rad]

    def __post_init__(self) -> None:
        for field in fields(self):
            name = field.name
            value = checked_array(
                *(getattr(self, name), f"servo {name}"),
                low=0.0 if name == "dead_zone" else -np.inf,
                above=-np.inf if name in ("delay", "dead_zone") else 0.0,
                high=LONGEST_DELAY if name == "delay" else np.inf,
            )
            value.flags.writeable = False
            object.__setattr__(self, name, value)


def read_servos(path: str | Path, n: int) -> PositionServos | None:
    """Return the servos of n joints in a friction TOML; None where it has no ``[servo]``.

    Raise a StictionError for an unreadable TOML, or a table of other than n servos.
    """
    table = read_toml(Path(path)).get("servo")
    if table is None:
        return None
    names = [f.name for f in fields(PositionServos)]
    if missing := [x for x in names if not isinstance(table, dict) or x not in table]:
        raise StictionError(f"{path}: [servo] {missing[0]} is missing")
    try:
        return PositionServos(**{x: checked_array(table[x], f"[servo] {x}", (n,)) for x in names})
    except StictionError as error:
        raise StictionError(f"{path}: {error}") from None
