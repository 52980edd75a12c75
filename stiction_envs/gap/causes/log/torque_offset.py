"""A constant torque bias, in logs and in torque tables."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import (
    OFFSET,
    Array,
    Cause,
    Parameter,
    Prior,
    Shape,
    View,
    variable,
)
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.servo.servo_parameters import BOTH_SIDES, InServo
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.tables.data import Effect, TableData

USUAL = 0.01
"""Offset of a sensor without a fault over the joint's largest torque [-]; assumed."""

IN_TABLES, MOST = 0.15, 0.8
"""Prior size, and largest torque in tables, over friction [-]; assumed."""
THIRD_POSE = "base torques in a third pose with another load"
STRONG = "a dither that takes away a third of the torque or more: an added torque stays as it was"


class TorqueOffset(Cause):
    """Zero of a sensor, or a calibration."""

    name: ClassVar[str] = "torque_offset"
    what: ClassVar[str] = "constant torque bias (sensor, calibration)"
    what_to_record: ClassVar[str] = (
        "static poses on both sides of the joint's range, and rests in motion"
    )
    shown_at_rest: ClassVar[bool] = True
    adds_to: ClassVar[str] = OFFSET
    tell_apart: ClassVar[Mapping[str, str]] = {
        "gravity_error": THIRD_POSE,
        "direction_asymmetry": STRONG,
    }
    words: ClassVar[str] = "an added torque of {offset_nm:+.3g} N·m"
    parameters: ClassVar = (Parameter("offset_nm", "N·m"),)
    view: ClassVar = View("joint angle [rad]", variable("q"), note="the same torque everywhere")
    servo: ClassVar = InServo(tells_apart=BOTH_SIDES)

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return three times the offset of usual sensors [N·m]; assumed."""
        usual = USUAL * float(data.arm.limits.torque[joint])
        return Prior(np.array([3 * usual]), usual=usual)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return ones."""
        return np.ones((len(data.q), 1))

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Add a torque that the motor must overcome."""
        draft.values["offset"][part.joint - 1] += part.coefficients[0]

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield a torque that shifts both directions equally; dither does not reduce it."""
        for j, rows in data.of_joint.items():
            unit = float(data.unit[rows].min())
            yield Effect(
                self.name,
                (j,),
                rows,
                size=IN_TABLES * unit,
                most=MOST * unit,
                trials=(1.0,),
                torque=data.sign[rows],
                parameters={"offset_nm": 1.0},
            )

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return the offset with it."""
        return {"offset": friction.offset[j] + values["offset_nm"]}
