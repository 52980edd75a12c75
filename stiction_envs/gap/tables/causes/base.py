"""The interface of a table cause: all that the project knows of it, in one class.

A table cause is something that a simulation gets wrong about breakaway torques. To add one, derive
from `TableCause` (or `SimulatedCause`) and call `stiction_envs.gap.tables.causes.register` with an
instance. Nothing else names it. It states hypotheses of one unknown x each (`Hypothesis`), which is

* another value of a `quantity` of the simulation,
* a torque that is `added` to the readings, or
* a factor on friction, whose logarithm `level` returns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.tables.readings import Comparison, TableData
from stiction_envs.gap.tables.whole_arm import Quantity
from stiction_envs.reporting.markdown import joints

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Wheres = tuple[Configuration, ...]
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
    units: ClassVar[Mapping[str, str]] = {}
    """Units of its parameters that have one."""
    logarithmic: ClassVar[bool] = True
    """Whether x is the logarithm of its parameter."""
    quantity: ClassVar[Quantity | None] = None
    """What the simulation varies; None for a cause that needs no simulation."""
    repeatable: ClassVar[bool] = False
    """Whether one joint may have several of its hypotheses, about different poses."""
    tell_apart: ClassVar[Mapping[str, str]] = {}
    """The measurement that distinguishes it from each other cause; one of the two names it."""

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield its hypotheses, given the configurations that were measured of each joint."""
        yield from (Hypothesis(self, where) for where in wheres.values())

    @abstractmethod
    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return the range of x."""

    def added(self, data: TableData, rows: Index) -> Array | None:
        """Return (rows,) torque that it adds to readings per unit of x; None for none."""
        return None

    def level(self, data: TableData, rows: Index, x: Array) -> Array | None:
        """Return (m, rows) logarithm of its factor on friction for x (m,); None for no factor."""
        return None

    @abstractmethod
    def evidence(self, some: Sequence[Hypothesis], x: Sequence[float], seen: Comparison) -> str:
        """Return one sentence that can be checked in the tables.

        Args:
            some: its hypotheses.
            x: value of each.
            seen: predictions with and without them.
        """

    def more_parameters(
        self, estimate: Estimate, joint: int, data: TableData
    ) -> dict[str, Estimate]:
        """Return its other parameters, which follow from the first."""
        return {}

    def indistinguishable_from(self, some: Sequence[Hypothesis]) -> tuple[str, ...]:
        """Return names of causes that no such table distinguishes from it."""
        return ()

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
    """A cause in some configurations, with one unknown x: a logarithm, or a torque [N·m]."""

    cause: TableCause
    where: Wheres
    """The configurations."""

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def joints(self) -> tuple[int, ...]:
        """The joints, in order."""
        return tuple(sorted({w.joint for w in self.where}))

    @property
    def scope(self) -> str:
        """Its pose and direction in words."""
        if len(self.where) == 1:
            return f"{self.where[0].load} {self.where[0].direction}"
        loads = sorted({w.load for w in self.where})
        return loads[0] if len(loads) == 1 else "both poses"


class SimulatedCause(TableCause):
    """A cause that needs a simulation: a factor on a friction parameter of a joint."""

    quantity: ClassVar[Quantity]
    parameter = "factor"
    absolute: ClassVar[str] = ""
    """Name of the parameter's value in its own unit; empty for none."""

    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return the range of the quantity."""
        return float(np.log(self.quantity.low)), float(np.log(self.quantity.high))

    def changed_to(self, value: float) -> str:
        """Return the value of the quantity in words."""
        return f"{value:.2f} times the {self.quantity.fields[0].replace('_', ' ')}"

    def evidence(self, some: Sequence[Hypothesis], x: Sequence[float], seen: Comparison) -> str:
        """Return the change of torque at the frequency of the largest effect [%]."""
        data, h = seen.data, some[0]
        r = data.readings
        rows, frequency = r.of_joints(h.joints), r.frequency
        effect = np.abs(seen.with_it - seen.without) / data.unit
        clearest = max(
            {float(f) for f in frequency[rows] if f},
            key=lambda f: effect[rows][frequency[rows] == f].mean(),
        )
        at = [int(i) for i in rows if frequency[i] == clearest]
        measured, before, after = (
            100 * np.mean([v[i] / r.base_of(v, i) - 1 for i in at])
            for v in (r.torque, seen.without, seen.with_it)
        )
        return (
            f"{clearest:g} Hz dither changes the torque of {joints(h.joints)} by "
            f"{measured:+.1f} % on average over {len(at)} readings; the simulation says "
            f"{before:+.1f} %, and with {self.changed_to(float(np.exp(x[0])))} {after:+.1f} %"
        )

    def more_parameters(
        self, estimate: Estimate, joint: int, data: TableData
    ) -> dict[str, Estimate]:
        """Return the value in the unit of the friction parameter."""
        if not self.absolute:
            return {}
        unit = data.nominal(self.quantity.fields[0], joint)
        low, high = estimate.ci95
        interval = unit * low, unit * high
        value = unit * float(np.mean(estimate.value))
        return {self.absolute: Estimate(value=value, ci95=interval, on_bound=estimate.on_bound)}

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return the friction parameters times the factor."""
        factor = only(values, self.parameter)
        return {f: getattr(friction, f)[j] * factor for f in self.quantity.fields}


def only(values: Mapping[str, float], key: str) -> float:
    """Return a parameter, whatever pose its name contains."""
    return next(v for k, v in values.items() if k.split()[0] == key)
