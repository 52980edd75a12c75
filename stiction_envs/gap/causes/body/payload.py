"""A body on the flange that the model lacks, or that only the model has: mass and centre."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape
from stiction_envs.gap.causes.body.bodies import (
    body_columns,
    from_flange,
    payload_directions,
    payload_of,
    with_payload,
)
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.motion import changes
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import consistent, inertial_parameters

HEAVY = 1.0
"""A payload whose weight must be seen to change [kg]."""
SMALL = 0.02
"""Mass under which a centre of mass means nothing [kg]."""
LEFT = 0.05
"""Part of the last link's mass that stays with it at least [-]."""
INERTIA_SD = 0.01
"""How far an inertia may be off a point's [kg·m²]: a kilogram 10 cm about its centre."""
MOST_INERTIA = 0.03
"""The same at most [kg·m²]: slow motion shows none, and the fit is then free to want any: a
kilogram 17 cm about its centre."""
LEAST_INERTIA = 0.001
"""Least eigenvalue of the inertia of what is left of a link about its centre, or of a payload, over
the mean of the link's own, or of a small sphere's [-]. Far below any body's, far above rounding."""


class Payload(Cause):
    """A tool, a gripper, a cable's weight; or one that is in the model and not on the robot.

    Its inertia is near that of a small sphere about its centre: it has a prior, for what torques of
    a slow motion show of it is wrong on the next. The columns are linear about a centre that is the
    nonlinear parameter, worked out anew as it is found (`payload_directions`).
    """

    name: ClassVar[str] = "payload"
    what: ClassVar[str] = "unmodelled mass on the flange"
    what_to_record: ClassVar[str] = "static poses with the flange turned all ways"
    arm_wide: ClassVar[bool] = True
    shown_at_rest: ClassVar[bool] = True
    changes_arm: ClassVar[bool] = True
    refinable: ClassVar[bool] = False
    dependent_parameters: ClassVar[int] = 9  # the centre of linearisation; inertia has a prior
    parameters: ClassVar = (Parameter("mass_kg", "kg"), Parameter("com_m", "m", size=3))

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the flange itself: where its centre is, is not known yet."""
        return [(0.0, 0.0, 0.0)]

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque per kilogram, and per kg·m of moment about the flange in its axes."""
        change = from_flange(data.pinocchio, data.arm) @ payload_directions(np.array(shape))
        last = data.recording.derived(body_columns, *data.gravity_found)[:, joint, -10:]
        return np.asarray(last @ change)

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the centre that was found."""
        if abs(float(coefficients[0])) <= SMALL:
            return shape
        x, y, z = (float(v) for v in coefficients[1:4] / coefficients[0])
        return x, y, z

    def at_edge(self, shape: Shape, shapes: list[Shape], edge: float) -> bool:
        """Never: the centre is where it is found."""
        return False

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return any mass, and what may be taken off the last link; an inertia of its size."""
        most = np.array([*[np.inf] * 4, *[MOST_INERTIA] * 6])
        low = -most
        low[0] = -(1 - LEFT) * float(data.recording.derived(_last_mass)[0])
        return low, most

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Return whether nothing is left of the last link; its inertia is not what it is about."""
        return bool(coefficients[0] <= self.bounds(data, joint)[0][0])

    def prior(self, data: Data, joint: int) -> Array:
        """Return any mass and centre, and an inertia like a point's."""
        return np.array([*[np.inf] * 4, *[INERTIA_SD] * 6])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return mass [kg] and centre of mass in the flange's axes [m]."""
        mass = float(coefficients[0])
        com = coefficients[1:4] / mass if abs(mass) > SMALL else np.zeros(3)
        return {"mass_kg": mass, "com_m": [float(x) for x in com]}

    def describe(self, coefficients: Array) -> str:
        """Return which of the two has it."""
        mass = float(coefficients[0])
        if mass >= 0:
            return f"{self.what}, or a last link that is heavier than the model's"
        return f"the model carries {-mass:.3g} kg too much on the flange"

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Return whether its mass is none."""
        return bool(abs(coefficients[0]) <= SMALL)

    def part_of(self, coefficients: Array, shape: Shape) -> tuple[Array, Shape]:
        """Return the ten parameters of the body about the flange."""
        return payload_of(coefficients, LEAST_INERTIA), ()

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm with the body, or without it."""
        phi = np.array(part.coefficients)
        if phi.shape != (10,) or (phi[0] > 0 and not consistent(phi)):
            raise StictionError(
                f"cause {self.name}: no body has the parameters {list(part.coefficients)}: "
                "expected mass, first moment (3) and inertia (6) about the flange"
            )
        return with_payload(arm, phi, LEAST_INERTIA)

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say where it is; the body itself is the arm's."""
        draft.not_in_tables.append(f"{self.name}: in [[cause]] and model.xml")

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the arm holds one pose only."""
        if float(np.ptp(data.q, axis=0).max()) < data.settings.motion.travel_span:
            return "the arm holds one pose only"
        weight = np.stack([self.columns(data, j, (0.0,) * 3)[:, 0] for j in range(data.n)], axis=1)
        if not changes(data, HEAVY * weight).any():
            return "a payload's weight hardly changes any torque along this motion"
        return ""


def _last_mass(recording: Recording) -> Array:
    """Return (1,) mass of the last link and of what is fixed to it [kg]."""
    return inertial_parameters(recording.pinocchio)[-1:, 0]
