"""A base that leans: gravity has a part along the base's x and y."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.causes.body.bodies import leaning
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.causes.motion import changes, holds_one_pose
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.robots import Arm

LEAN = 0.05
"""Inclination that must change torques visibly [rad]; assumed."""


class BaseTilt(Cause):
    """An inclined mount that the gravity of the controller or the simulation lacks."""

    name: ClassVar[str] = "base_tilt"
    what: ClassVar[str] = "gravity points elsewhere (inclined mount)"
    what_to_record: ClassVar[str] = (
        "static poses with the arm stretched to all sides, joint 1 turned round"
    )
    arm_wide: ClassVar[bool] = True
    shown_at_rest: ClassVar[bool] = True
    changes_arm: ClassVar[bool] = True
    parameters: ClassVar = (
        Parameter("tilt_rad", "rad", size=2, low=-1.0, high=1.0),
        Parameter("azimuth_rad", "rad", low=0.0, high=0.3, size=1),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque per sin(tilt) towards x and y, and per 1 − cos(tilt) lost."""
        return data.recording.derived(_sideways)[:, joint]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the lean [rad] and the direction towards which the base leans [rad]."""
        lean = float(np.hypot(*coefficients[:2]))
        return {
            "tilt_rad": float(np.arcsin(min(lean, 1.0))),
            "azimuth_rad": float(np.arctan2(coefficients[1], coefficients[0])),
        }

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Return whether the base lies on its side; 1 − cos(tilt) may be near its bound zero."""
        return bool(np.any(np.abs(coefficients[:2]) >= 1.0))

    def part_of(self, coefficients: Array, shape: Shape) -> tuple[Array, Shape]:
        """Return the lean; the loss of gravity along its nominal direction follows from it."""
        x, y = coefficients[:2]
        return np.array([x, y, 1 - np.sqrt(max(1 - x * x - y * y, 0.0))]), shape

    def lean(self, coefficients: Array) -> Array:
        """Return (2,) part of gravity towards x and y [-]."""
        return coefficients[:2]

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm under a gravity that leans."""
        return leaning(arm, np.array(part.coefficients[:2]))

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the arm holds one pose only."""
        if missing := holds_one_pose(data):
            return missing
        for k in range(2):
            sideways = data.recording.derived(_sideways)[..., k]
            if not changes(data, LEAN * sideways).any():
                return "a lean of the base hardly changes any torque along this motion"
        return ""


def _sideways(recording: Recording) -> Array:
    """Return (T, n, 3) gravity torque of g along x and along y, and minus that of the nominal."""
    model = recording.pinocchio.copy()
    g = float(np.linalg.norm(model.gravity.linear))
    out = np.empty((len(recording.t), recording.n, 3))
    for k in range(2):
        direction = np.zeros(3)
        direction[k] = g
        model.gravity.linear = direction
        out[..., k] = gravity_torque(model, recording.q)
    out[..., 2] = -recording.gravity
    return out
