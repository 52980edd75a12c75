"""A wrong torque gain: measured = s × true, so that the residual is (s − 1) times the torque."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.causes.view import View
from stiction_envs.gap.signals.dataset import Data

LOWEST = 0.5
"""Gain beyond which no sensor or ratio would have gone unnoticed: it is another mass, or friction
[-]."""
HIGHEST = 2.0
"""The same on the other side [-]."""
LEAST_ERROR = 0.002
"""Error of a gain that is none [-]: torque sensors are linear to some tenths of a per cent."""


class TorqueScale(Cause):
    """Gain of a torque sensor, motor constant or gear ratio."""

    name: ClassVar[str] = "torque_scale"
    what: ClassVar[str] = "torque gain wrong"
    what_to_record: ClassVar[str] = "poses of large and small gravity torque, with a known weight"
    shown_at_rest: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("scale", "1", LOWEST, HIGHEST, neutral=1.0),)
    view: ClassVar = View(
        "nominal torque [N·m]",
        lambda data, joint, shape: data.nominal[:, joint],
        note="a slope: an error in proportion to the torque",
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the nominal torque and the load."""
        torque = data.nominal[:, joint, None]
        return torque if data.carried is None else torque + data.carried[:, joint, None]

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Return whether the gain is as right as gains are."""
        return abs(float(coefficients[0])) < LEAST_ERROR

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return the bounds of s − 1."""
        return np.array([LOWEST - 1.0]), np.array([HIGHEST - 1.0])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return s [-]."""
        return {"scale": 1.0 + float(coefficients[0])}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say by what to divide: it is the log that is wrong, not the arm."""
        scale = self.parameters_of(part)["scale"]
        draft.leave_out(part, f"divide the logged torque by {scale:.4g}")

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the joint carries too little torque."""
        size = float(data.nominal[:, joint].std())
        if size < data.settings.noise.clear * data.noise[joint]:
            return f"joint {joint + 1} carries no torque that changes"
        return ""
