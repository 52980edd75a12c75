"""A wrong torque gain: measured = s × true, so that the residual is (s − 1) times the torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, constants
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.causes.view import View
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.method_settings import check_numbers


@dataclass(frozen=True, kw_only=True)
class TorqueScaleSettings:
    """Gains that can be."""

    lowest: float
    """Gain beyond which no sensor or ratio would have gone unnoticed: it is another mass, or
    friction [-]."""
    highest: float
    """The same on the other side [-]."""
    least_error: float
    """Error of a gain that is none [-]: torque sensors are linear to some tenths of a per cent."""

    def __post_init__(self) -> None:
        check_numbers(self)


class TorqueScale(Cause):
    """Gain of a torque sensor, motor constant or gear ratio."""

    name: ClassVar[str] = "torque_scale"
    settings: TorqueScaleSettings = constants(TorqueScaleSettings, name)
    what: ClassVar[str] = "torque gain wrong"
    what_to_record: ClassVar[str] = "poses of large and small gravity torque, with a known weight"
    shown_at_rest: ClassVar[bool] = True
    parameters: ClassVar = (
        Parameter("scale", "1", settings.lowest, settings.highest, neutral=1.0),
    )
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
        return abs(float(coefficients[0])) < self.settings.least_error

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return the bounds of s − 1."""
        return np.array([self.settings.lowest - 1.0]), np.array([self.settings.highest - 1.0])

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
