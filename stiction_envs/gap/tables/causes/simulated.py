"""Causes that are another value of a friction parameter: simulations say what that changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import Array, Cause
from stiction_envs.gap.tables.data import Effect, TableData
from stiction_envs.gap.tables.whole_arm import Quantity

TRIALS = (-1.8, -0.8, -0.3, 0.3, 0.8, 1.8)
"""Logarithms of the factor that are tried, over its prior size [-]; assumed."""
SAME_DAY = "base and dithered torques measured in turn on one day"


class SimulatedCause(Cause):
    """A factor on friction parameters of a joint."""

    quantity: ClassVar[Quantity]
    absolute: ClassVar[str] = ""
    """Name of the parameter's value in its own unit; empty for none."""
    log_size: ClassVar[float] = 0.5
    """Prior size of the factor's logarithm [-]; assumed."""

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield the factor on each joint."""
        for j, rows in data.of_joint.items():
            unit = data.nominal(self.quantity.fields[0], j)
            yield Effect(
                self.name,
                (j,),
                rows,
                size=self.log_size,
                trials=TRIALS,
                quantity=self.quantity,
                parameters={"factor": 1.0} | ({self.absolute: unit} if self.absolute else {}),
                log=True,
            )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the factor in words."""
        return f"{values['factor']:.2f} times the {self.quantity.fields[0].replace('_', ' ')}"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return the friction parameters times the factor."""
        return {f: getattr(friction, f)[j] * values["factor"] for f in self.quantity.fields}
