"""A body on the flange that the model lacks, or that only the model has: mass and centre."""

from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import LINK, THE_ARM, Array, Cause, Parameter, Prior, Shape
from stiction_envs.gap.causes.body.bodies import (
    body_columns,
    from_flange,
    link_masses,
    payload_directions,
    payload_of,
    with_payload,
)
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import reach_of
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import consistent

SMALL = 0.02
"""Mass below which there is no centre of mass [kg]; assumed."""
LEFT = 0.05
"""Least part of the last link's mass that remains [-]; assumed."""
MOST_INERTIA = 0.03
"""Largest such inertia [kg·m²], since slow motion does not limit it; assumed: a kilogram 17 cm from
its centre."""
USUAL_SHARE = 0.3
"""Mass of usual tools over what the arm can lift at its reach [-]; assumed."""
USUAL_CENTRE = 0.1
"""Distance of their centre from the flange, and twice their radius of gyration [m]; assumed."""
LEAST_PARTS = np.array([0.3, *[0.0] * 9])
"""Least part of its usual sizes that a small body's prior keeps [-]; assumed. A tenth of the mass
would draw it towards zero, since links may take its place."""
LEAST_INERTIA = 0.001
"""Least eigenvalue of the inertia about the centre, of a payload or of the rest of a link, over the
mean of a small sphere's or of the link's [-]; assumed: far below any body's, far above rounding."""


class Payload(Cause):
    """A tool, a gripper, a cable's weight; or a body that only the model has.

    The body's inertia has a prior about that of a small sphere at its centre, because slow motion
    hardly shows inertia. The columns are linear about a centre, the nonlinear parameter; they are
    computed again at the fitted centre (`payload_directions`).
    """

    name: ClassVar[str] = "payload"
    what: ClassVar[str] = "unmodelled mass on the flange"
    what_to_record: ClassVar[str] = "static poses with the flange turned all ways"
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = THE_ARM
    adds_to: ClassVar[str] = LINK
    parameters: ClassVar = (Parameter("mass_kg", "kg"), Parameter("com_m", "m", size=3))
    servo: ClassVar = InServo(
        evidence="joints sag together, as under a body of {value:.3g} kg at the flange",
        alike=(
            *("encoder_offset", "gravity_compensation_missing"),
            *("link_parameters", "servo_stiffness"),
        ),
        tells_apart="a log with another, known mass at the tip",
    )

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the flange as first guess of the centre."""
        return [(0.0, 0.0, 0.0)]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a usual mass, 10 cm off the flange.

        Some of the last link must remain. Tools are mounted all the time.
        """
        reach = max(reach_of(data.recording.pinocchio), 0.1)
        mass = USUAL_SHARE * float(data.strength.max() / (9.81 * reach))
        size = mass * np.array([1.0, *[USUAL_CENTRE] * 3, *[(USUAL_CENTRE / 2) ** 2] * 6])
        high = np.array([*[np.inf] * 4, *[MOST_INERTIA] * 6])
        low = -high
        low[0] = self._least(data)
        return Prior(size, low, high, odds=1.0, everywhere=True, least=LEAST_PARTS)

    def _least(self, data: Data) -> float:
        """Return the least mass that leaves a last link [kg]."""
        return -(1 - LEFT) * float(data.recording.derived(link_masses)[-1])

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque per kilogram, and per kg·m of moment about the flange in its axes."""
        own = slice(4 * data.n, 4 * data.n + 10)
        last = data.recording.derived(body_columns, *data.gravity_found)[..., own]
        return np.asarray(last @ self._directions(data, shape))

    def _directions(self, data: Data, shape: Shape) -> Array:
        """Return (10, 10) change of the last link's parameters per coefficient."""
        flange = from_flange(data.recording.pinocchio, data.arm)
        return np.asarray(flange @ payload_directions(np.array(shape)))

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the centre that was found."""
        if abs(float(coefficients[0])) <= SMALL:
            return shape
        x, y, z = (float(v) for v in coefficients[1:4] / coefficients[0])
        return x, y, z

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether it has a mass and leaves a last link; its inertia may be on a bound."""
        mass = float(coefficients[0])
        return abs(mass) > SMALL and mass > self._least(data)

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return mass [kg] and centre of mass in the flange's axes [m]."""
        mass = float(coefficients[0])
        com = coefficients[1:4] / mass if abs(mass) > SMALL else np.zeros(3)
        return {"mass_kg": mass, "com_m": [float(x) for x in com]}

    def describe(self, data: Data, coefficients: Array, shape: Shape) -> str:
        """Return whether the robot or the model has it."""
        mass = float(coefficients[0])
        if mass >= 0:
            return f"{self.what}, or a last link that is heavier than the model's"
        return f"the model carries {-mass:.3g} kg too much on the flange"

    def on_links(self, data: Data, joint: int, shape: Shape, size: int) -> Array:
        """Return the change of the last link's parameters."""
        return np.concatenate([np.zeros((10 * (data.n - 1), size)), self._directions(data, shape)])

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
