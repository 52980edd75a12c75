"""The interface of a table cause: all that the project knows of it, in one class.

A table cause is something that a simulation gets wrong about breakaway torques. To add one, derive
from `TableCause` (or `SimulatedCause`) and call `stiction_envs.gap.tables.causes.register` with an
instance. Nothing else names it. It states hypotheses of one unknown x each (`Hypothesis`), which is

* the logarithm of a `quantity` of the simulation over its nominal value,
* a `torque` that is added to readings, or
* a factor on friction, whose logarithm `level` returns.

Each x is 0 in the nominal model, and has a Gaussian prior of the cause's own size.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.readings import Readings, TableData
from stiction_envs.gap.tables.whole_arm import Quantity

Array = NDArray[np.float64]
SAME_DAY = "base and dithered torques measured in turn on one day"
OTHER_JOINTS = "the same dither on the other joints: a filter acts on all of them"
THIRD_POSE = "base torques in a third pose with another load"
BASE_AGAIN = "the base torque measured again"


class TableCause(ABC):
    """Something that a simulation gets wrong about breakaway torques; see the module."""

    name: ClassVar[str]
    """In files and reports: small letters, digits and underscores."""
    parameter: ClassVar[str]
    """Name of its number in ``diagnosis.json``."""
    quantity: ClassVar[Quantity | None] = None
    """What the simulation varies; None for a cause that needs no simulation."""
    trials: ClassVar[tuple[float, ...]] = (-0.7, 0.7)
    """Values of x over its prior size to which its effect is a straight line [-]; assumed."""
    odds: ClassVar[float] = 0.0
    """Prior odds over those of other causes [nats]."""
    separate: ClassVar[bool] = False
    """Whether each of its hypotheses is a bad reading, and not a property of the arm."""
    tell_apart: ClassVar[Mapping[str, str]] = {}
    """The measurement that distinguishes it from each other cause; one of the two names it."""

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield its hypotheses, by default one of all readings of each joint."""
        for j in readings.joints:
            yield Hypothesis(self, (j,), tuple(readings.of_joints([j]).tolist()))

    @abstractmethod
    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the standard deviation of the prior of x."""

    def bounds(self, data: TableData, h: Hypothesis) -> tuple[float, float]:
        """Return the least and the largest x."""
        return -np.inf, np.inf

    def torque(self, data: TableData, h: Hypothesis) -> Array | None:
        """Return (rows,) torque that it adds to its readings per unit of x; None for none."""
        return None

    def level(self, data: TableData, h: Hypothesis, x: float) -> Array | float | None:
        """Return the logarithm of its factor on friction, one or (rows,); None for no factor."""
        return None

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the parameters of ``diagnosis.json`` for x; a longer key names a part."""
        return {f"{self.parameter} {h.scope}".strip(): float(np.exp(x))}

    def what(self, values: Mapping[str, float]) -> str:
        """Return what is wrong in words, a noun with its value."""
        return ", ".join(f"{k} {v:.3g}" for k, v in values.items())

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the friction parameters that it changes, of a joint.

        Args:
            friction: friction without it.
            poses: poses of the experiment.
            j: joint, from 0.
            values: its parameters by name.
        """
        return {}

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return why a model of the arm cannot hold it, a clause; nothing if it can."""
        return ""


@dataclass(frozen=True)
class Hypothesis:
    """A cause about some readings, with one unknown x."""

    cause: TableCause
    joints: tuple[int, ...]
    """From 1; several only for a quantity that they have in common."""
    rows: tuple[int, ...]
    """The readings."""
    scope: str = ""
    """Pose and direction in words; empty for all of its joints."""

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name


class SimulatedCause(TableCause):
    """A cause that needs a simulation: a factor on a friction parameter of a joint."""

    quantity: ClassVar[Quantity]
    parameter = "factor"
    trials = (-1.8, -0.8, -0.3, 0.3, 0.8, 1.8)
    absolute: ClassVar[str] = ""
    """Name of the parameter's value in its own unit; empty for none."""
    log_size: ClassVar[float] = 0.5
    """Prior size of the factor's logarithm [-]; assumed."""

    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the size of the factor's logarithm."""
        return self.log_size

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the factor, and the value in the unit of the friction parameter."""
        factor = float(np.exp(x))
        unit = data.nominal(self.quantity.fields[0], h.joints[0]) if self.absolute else 0.0
        return {self.parameter: factor} | ({self.absolute: unit * factor} if self.absolute else {})

    def what(self, values: Mapping[str, float]) -> str:
        """Return the factor in words."""
        return f"{values['factor']:.2f} times the {self.quantity.fields[0].replace('_', ' ')}"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the friction parameters times the factor."""
        factor = only(values, self.parameter)
        return {f: getattr(friction, f)[j] * factor for f in self.quantity.fields}


def only(values: Mapping[str, float], key: str) -> float:
    """Return a parameter, whatever pose its name contains."""
    return next(v for k, v in values.items() if k.split()[0] == key)
