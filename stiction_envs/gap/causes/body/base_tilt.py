"""A base that leans: gravity has a part along the base's x and y."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import GRAVITY, THE_ARM, Array, Cause, Parameter, Prior, Shape
from stiction_envs.gap.causes.body.bodies import leaning
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import gravity_by_axis
from stiction_envs.robots import Arm

LEAST = 0.02
"""Lean up to which gravity keeps its size along the nominal direction [-]: it loses 0.0002."""
MOST = 0.99
"""Largest lean [-]; assumed: a base on its side has another model."""
USUAL = 0.003
"""Lean of a base that was levelled [-]; assumed."""


class BaseTilt(Cause):
    """An inclined mount that the gravity of the controller or the simulation lacks.

    Gravity that leans by (x, y) also loses 1 − cos(tilt) = 1 − √(1 − x² − y²) along its nominal
    direction. That is k (x x_0 + y y_0) with k = (1 − cos(tilt))/(x_0² + y_0²), which is exact at
    (x, y) = (x_0, y_0), the nonlinear parameters. They are computed anew once a tilt is found.
    """

    name: ClassVar[str] = "base_tilt"
    what: ClassVar[str] = "gravity points elsewhere (inclined mount)"
    what_to_record: ClassVar[str] = (
        "static poses with the arm stretched to all sides, joint 1 turned round"
    )
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = THE_ARM
    adds_to: ClassVar[str] = GRAVITY
    parameters: ClassVar = (
        Parameter("tilt_rad", "rad", size=2, low=-1.0, high=1.0),
        Parameter("azimuth_rad", "rad", size=0),
    )

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return (x_0, y_0) to try: upright, and the fit of a lean alone."""
        rows = data.block >= 0
        torque = (data.residual[rows] - data.residual[rows].mean(axis=0)) / data.noise
        side = data.recording.derived(_sideways)[rows]
        side = (side - side.mean(axis=0)) / data.noise[:, None]
        x, y, _ = np.linalg.lstsq(side.reshape(-1, 3), torque.ravel(), rcond=None)[0]
        found = (float(x), float(y))
        return [(0.0, 0.0), found] if LEAST < np.hypot(float(x), float(y)) < MOST else [(0.0, 0.0)]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return the lean of a mount that was not levelled [-]; assumed."""
        return Prior(np.array([0.1, 0.1]), usual=USUAL)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque per sin(tilt) towards x and y."""
        side, lean = data.recording.derived(_sideways), float(np.linalg.norm(shape))
        if not lean:
            return np.array(side[..., :2])
        lost = (1 - np.sqrt(1 - lean * lean)) / (lean * lean)
        return np.asarray(side[..., :2] + lost * side[..., 2:] * np.array(shape))

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the lean that was found."""
        x, y = (float(v) for v in coefficients[:2])
        return (x, y) if LEAST < np.hypot(x, y) < MOST else shape

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the lean [rad] and the direction towards which the base leans [rad]."""
        lean = float(np.hypot(*coefficients[:2]))
        return {
            "tilt_rad": float(np.arcsin(min(lean, 1.0))),
            "azimuth_rad": float(np.arctan2(coefficients[1], coefficients[0])),
        }

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether the base does not lie on its side."""
        return bool(np.hypot(*coefficients[:2]) < MOST)

    def part_of(self, coefficients: Array, shape: Shape) -> tuple[Array, Shape]:
        """Return the lean, and the loss of gravity along its nominal direction that follows."""
        x, y = coefficients[:2]
        return np.array([x, y, 1 - np.sqrt(max(1 - x * x - y * y, 0.0))]), ()

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm under a gravity that leans."""
        return leaning(arm, np.array(part.coefficients[:2]))


def _sideways(recording: Recording) -> Array:
    """Return (T, n, 3) gravity torque of g along x and along y, and minus that of the nominal."""
    side = gravity_by_axis(recording.pinocchio, recording.q, axes=2)
    return np.concatenate([side, -recording.gravity[..., None]], axis=2)
