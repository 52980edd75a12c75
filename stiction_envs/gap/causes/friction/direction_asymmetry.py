"""Dry friction that differs by direction: F_+ − F_− = 2a, so that τ = a while the joint moves."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View, variable
from stiction_envs.gap.causes.draft import LEAST_FRICTION, ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.log.torque_offset import IN_TABLES, MOST
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.tables.data import Effect, TableData


class DirectionAsymmetry(Cause):
    """Half the difference of dry friction between + and −; zero at rest."""

    name: ClassVar[str] = "direction_asymmetry"
    what: ClassVar[str] = "dry friction differs by direction"
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = (
        "slow motion in both directions with long rests, against an offset"
    )
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("asymmetry_nm", "N·m"),)
    view: ClassVar = View(
        "joint speed [rad/s]", variable("dq"), note="both directions lie off zero to the same side"
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a fiftieth of what the joint can bear [N·m]; assumed."""
        return Prior(np.array([0.02 * data.strength[joint]]), odds=2.0)

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether friction resists in both directions."""
        return abs(float(coefficients[0])) <= level

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return one while the joint moves."""
        return data.growth(joint, data.side(joint))[:, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Split the levels of the friction tables by direction."""
        (half,) = part.coefficients
        both = np.array([half, -half])
        draft.coulomb[part.joint - 1] += both
        draft.values["stiction"][part.joint - 1] += both
        draft.leave_out(part, "MuJoCo's friction knows no direction: the mean stands", tables=False)

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield a shift of + and − that dither shrinks, alone and in place of an offset.

        A nominal model that was calibrated to the base torques has an offset of the same size: they
        do not distinguish the two.
        """
        for j, rows in data.of_joint.items():
            unit = float(data.unit[rows].min())
            for instead in (False, True):
                yield Effect(
                    self.name,
                    (j,),
                    rows,
                    scope="in place of an offset" * instead,
                    size=IN_TABLES * unit,
                    most=MOST * unit,
                    torque=-data.sign[rows] if instead else None,
                    level=partial(_level, data.sign[rows] / data.unit[rows]),
                    parameters={"asymmetry_nm": 1.0} | ({"offset_nm": -1.0} if instead else {}),
                )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the asymmetry in words."""
        instead = " in place of an offset" * ("offset_nm" in values)
        return f"dry friction {values['asymmetry_nm']:+.3g} N·m in +, as much less in -{instead}"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return stiction and offset with it."""
        more = values["asymmetry_nm"] * np.array([1, -1])
        return {
            "stiction": np.maximum(friction.stiction[j] + more, LEAST_FRICTION),
            "offset": friction.offset[j] + values.get("offset_nm", 0.0),
        }


def _level(part: Array, x: float) -> Array:
    return np.log1p(x * part)
