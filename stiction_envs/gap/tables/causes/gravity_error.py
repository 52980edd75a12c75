"""An error of the gravity model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from stiction_envs.arrays import Array
from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.causes.log.torque_offset import THIRD_POSE
from stiction_envs.gap.tables.data import Effect, TableData

SHARE = 0.05
"""Prior size of an error of the gravity model, over gravity [-]; assumed: of links."""
MOST = 0.5
"""Largest error of the gravity model, over gravity [-]; assumed: with more it is another arm."""


class GravityError(Cause):
    """An offset in proportion to the load of the pose."""

    name = "gravity_error"
    tell_apart: ClassVar[Mapping[str, str]] = {"direction_asymmetry": THIRD_POSE}

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield a share of each joint's load."""
        load = data.sign * data.whole.poses.signed[data.joint - 1, data.pose]
        for j, rows in data.of_joint.items():
            yield Effect(
                self.name,
                (j,),
                rows,
                size=SHARE,
                most=MOST,
                trials=(1.0,),
                torque=load[rows],
                parameters={"share_of_gravity": 1.0},
            )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the share in words."""
        return f"{100 * values['share_of_gravity']:+.2g} % of the joint's gravity torque"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return the error of the gravity model with it."""
        return {"gravity_error": friction.gravity_error[j] + values["share_of_gravity"]}
