"""A constant torque bias."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

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
from stiction_envs.gap.signals.dataset import Data

USUAL = 0.01
"""Offset of a sensor without a fault over the joint's largest torque [-]; assumed."""


class TorqueOffset(Cause):
    """Zero of a sensor, or a calibration."""

    name: ClassVar[str] = "torque_offset"
    what: ClassVar[str] = "constant torque bias (sensor, calibration)"
    what_to_record: ClassVar[str] = (
        "static poses on both sides of the joint's range, and rests in motion"
    )
    shown_at_rest: ClassVar[bool] = True
    adds_to: ClassVar[str] = OFFSET
    parameters: ClassVar = (Parameter("offset_nm", "N·m"),)
    view: ClassVar = View("joint angle [rad]", variable("q"), note="the same torque everywhere")

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return three times the offset of usual sensors [N·m]; assumed."""
        usual = USUAL * float(data.arm.limits.torque[joint])
        return Prior(np.array([3 * usual]), usual=usual)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return ones."""
        return np.ones((len(data.t), 1))

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Add a torque that the motor must overcome."""
        draft.offset[part.joint - 1] += part.coefficients[0]
