"""A wrong torque gain: measured = s × true, so that the residual is (s − 1) times the torque."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import (
    EITHER,
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
    acts_on: ClassVar[str] = EITHER  # another unit is one hypothesis, not one per joint
    least: ClassVar[float] = LEAST_ERROR
    parameters: ClassVar = (Parameter("scale", "1", neutral=1.0),)
    view: ClassVar = View(
        "nominal torque [N·m]",
        variable("nominal"),
        note="a slope: an error in proportion to the torque",
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return the error of another unit [-]."""
        return Prior(np.array([1.0]), usual=USUAL)

    def joints(self, data: Data) -> list[int]:
        """Return the joints with a torque, and the arm where all torques have the same unit."""
        first = 0 if len(set(data.unit)) > 1 else -1
        return [j for j in range(first, data.n) if j < 0 or data.measured[j]]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the unit of the joint's torque, by which it was divided."""
        unit = float(data.unit[joint % len(data.unit)])
        return [()] if unit == 1 else [(unit,)]

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the nominal torque and the load."""
        torque = data.nominal if data.carried is None else data.nominal + data.carried
        return torque[..., None] if joint < 0 else torque[:, joint, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the gain of the torques as they were logged."""
        return {"scale": (shape or (1.0,))[0] * (1 + float(coefficients[0]))}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say by what to divide: it is the log that is wrong, not the arm."""
        scale = (part.shape or (1.0,))[0] * (1 + part.coefficients[0])
        draft.leave_out(part, f"divide the logged torque by {scale:.4g}")
