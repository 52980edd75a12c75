"""One bad reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.tables.data import Effect, TableData

SIZE = 0.5
"""Prior size of a bad reading's error over friction [-]; assumed."""
CALIBRATED = 0.1
"""Prior size of the logarithm of the factor by which friction is off that was calibrated to a bad
reading [-]; assumed."""
RARE = 1.0
"""Log odds against bad readings [nats]; assumed."""


class CorruptedCell(Cause):
    """A reading far from what the model says, while its neighbours and repeats are not.

    A base torque may be bad although the simulation agrees with it: friction was calibrated to it,
    and then all dithered torques of its configuration are off by one factor.
    """

    name = "corrupted_cell"

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield each reading, and each base torque to which friction was calibrated."""
        for i, (joint, unit) in enumerate(zip(data.joint.tolist(), data.unit, strict=True)):
            yield Effect(
                cause=self.name,
                joints=(joint,),
                rows=np.array([i]),
                scope=str(i),
                size=SIZE * float(unit),
                trials=(1.0,),
                odds=RARE,
                torque=np.ones(1),
                values=partial(_error, data.sign[i]),
                bad=True,
            )
        for joint in data.joints:
            for where, rows in data.dithered(joint).items():
                yield Effect(
                    cause=self.name,
                    joints=(joint,),
                    rows=rows,
                    scope=f"base of {where}",
                    size=CALIBRATED,
                    odds=RARE,
                    level=float,
                    values=partial(_error_of_base, data.sign[rows[0]] * data.unit[rows[0]]),
                    bad=True,
                )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the error in words."""
        return f"a bad reading, {values['error_nm']:+.3g} N·m off"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> str:
        """Return that it is not a property of the arm."""
        return "a bad reading"


def _error(sign: float, x: float) -> dict[str, float]:
    return {"error_nm": float(sign * x)}


def _error_of_base(unit: float, x: float) -> dict[str, float]:
    return {"error_nm": float(unit * (np.exp(-x) - 1))}
