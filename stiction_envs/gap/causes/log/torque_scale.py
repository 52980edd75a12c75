"""A wrong torque gain: measured = s × true, so that the residual is (s − 1) times the torque."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data

LEAST_ERROR = 0.002
"""Error of a gain that does not count [-]; assumed: torque sensors are linear to some tenths of a
per cent."""

USUAL = 0.01
"""Error of a gain without a fault [-]; assumed."""


class TorqueScale(Cause):
    """Gain of a torque sensor, motor constant or gear ratio."""

    name: ClassVar[str] = "torque_scale"
    what: ClassVar[str] = "torque gain wrong"
    what_to_record: ClassVar[str] = "poses of large and small gravity torque, with a known weight"
    shown_at_rest: ClassVar[bool] = True
    arm_too: ClassVar[bool] = True  # another unit is one hypothesis, not one per joint
    parameters: ClassVar = (Parameter("scale", "1", neutral=1.0),)
    view: ClassVar = View(
        "nominal torque [N·m]",
        variable("nominal"),
        note="a slope: an error in proportion to the torque",
    )

    def size(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the error of another unit [-]."""
        return np.array([1.0])

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the nominal torque and the load."""
        torque = data.nominal[:, joint, None]
        return torque if data.carried is None else torque + data.carried[:, joint, None]

    def tolerance(self, data: Data, joint: int) -> float:
        """Return the error of usual gains [-]."""
        return USUAL

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Return whether the gain is right within the error of usual gains."""
        return abs(float(coefficients[0])) < LEAST_ERROR

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say by what to divide: it is the log that is wrong, not the arm."""
        scale = self.parameters_of(part)["scale"]
        draft.leave_out(part, f"divide the logged torque by {scale:.4g}")
