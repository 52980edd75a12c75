"""The conditions under which `treatments` compares: robot, stiffness, friction, senses, paths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

ROBOTS = ("panda", "iiwa7", "iiwa14")
STIFFNESS = ((200.0, 20.0, 0.0), (400.0, 40.0, 0.0))
FRICTIONS = (1.0, 1 / 0.7, 1 / 1.3)
"""True stiction over the believed one: known, believed 30 % too small, 30 % too large [-]."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What is the same for all treatments of a row."""

    robot: str
    stiffness: tuple[float, float, float]
    friction: float = 1.0
    """True stiction over that which the controller believes [-]."""
    delay_ms: float | None = None
    """Age of what the controller sees [ms]; None: ideal senses."""
    noise: float = 1.0
    """Noise over the robot's own [-]; counts with a delay."""
    load_kg: float = 0.0
    """On the flange, of which the controller was not told [kg]."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """Paths that all treatments of a row follow."""

    names: tuple[str, ...]
    iterations: int = 1
    """Runs of each."""


PENTAGON = Places(names=("pentagon",), iterations=8)


def random_places(count: int) -> Places:
    """Return random paths that no search draws: their numbers are from 1000 on."""
    return Places(names=tuple(f"random-{1000 + k}" for k in range(count)))


def searched(robot: str) -> list[Condition]:
    """Return the conditions for which gains are searched, friction known and wrong."""
    at = partial(Condition, robot=robot, stiffness=STIFFNESS[0], delay_ms=1.0)
    return [at(friction=f) for f in FRICTIONS]


def conditions(robot: str) -> list[Condition]:
    """Return the rows of a robot: friction, delay, noise, and friction wrong with real senses."""
    out = []
    for k in STIFFNESS:
        at = partial(Condition, robot=robot, stiffness=k)
        out += [at(friction=f) for f in FRICTIONS]
        out += [at(delay_ms=1.0, friction=f) for f in FRICTIONS]
        out += [at(delay_ms=d) for d in (0.0, 3.0, 5.0)]
        out += [at(delay_ms=1.0, noise=x) for x in (1 / 3, 3.0)]
        out += [at(delay_ms=1.0, load_kg=0.5)]
    return out
