"""One bad reading."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.tables.data import Effect, TableData

SIZE = 0.5
"""Prior size of a bad reading's error over friction [-]; assumed."""
CALIBRATED, MOST = 0.1, 0.8
"""Prior size, and largest error of a base torque to which friction was calibrated, over friction
[-]; assumed."""
RARE = 1.0
"""Log odds against bad readings [nats]; assumed."""


class CorruptedCell(Cause):
    """A reading far from what the model says, while its neighbours and repeats are not.

    A base torque may be bad although the simulation agrees with it: friction was calibrated to it,
    and then all dithered torques of its configuration are off by one factor.
    """

    name = "corrupted_cell"
    words = "a bad reading, {error_nm:+.3g} N·m off"
    not_in_friction = "a bad reading"

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield each reading, and each base torque to which friction was calibrated."""
        for i, (joint, unit) in enumerate(zip(data.joint.tolist(), data.unit, strict=True)):
            yield Effect(
                self.name,
                (joint,),
                np.array([i]),
                scope=str(i),
                size=SIZE * float(unit),
                trials=(1.0,),
                odds=RARE,
                torque=np.ones(1),
                parameters={"error_nm": float(data.sign[i])},
                bad=True,
            )
        for joint in data.joints:
            for where, rows in data.dithered(joint).items():
                yield Effect(
                    self.name,
                    (joint,),
                    rows,
                    scope=f"base of {where}",
                    size=CALIBRATED,
                    odds=RARE,
                    most=MOST,
                    level=lambda x: -np.log1p(x),
                    parameters={"error_nm": float(data.sign[rows[0]] * data.unit[rows[0]])},
                    bad=True,
                )
