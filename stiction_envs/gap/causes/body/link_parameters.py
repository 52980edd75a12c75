"""Mass and centre of a link, as far as torques show them."""

from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import (
    ALL_OF_ONE,
    LINK,
    Array,
    Cause,
    Columns,
    Parameter,
    Prior,
    Shape,
)
from stiction_envs.gap.causes.body.bodies import (
    body_columns,
    changed_link,
    link_directions,
    link_masses,
)
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters

MASS_SD = 0.3
"""Prior standard deviation of a link's mass about the model's, over it [-]; assumed: published and
identified masses of a link differ by as much."""
CENTRE_SDS = (0.03, 0.005)
"""Prior standard deviations of its centre in each direction [m]; assumed: a quarter of a link's
half length, and what a heavier cover moves it by."""
LEFT = 0.05
"""Least part of a link's mass that remains [-]; assumed."""
FARTHEST = 0.15
"""Largest distance of its centre from that in the model [m]; assumed: half a link's length."""


class LinkParameters(Cause):
    """A link whose mass or centre of mass differs from the model.

    The link's inertia changes too, J' = (1 + s) T(δ) J T(δ)ᵀ, and stays physically consistent. A
    prior about the nominal mass and moment decides what the motion does not show. An error of the
    last link is named `payload`.
    """

    name: ClassVar[str] = "link_parameters"
    what: ClassVar[str] = "a link's mass or centre wrong"
    what_to_record: ClassVar[str] = (
        "static poses over the whole range of all joints, then an exciting motion"
    )
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = ALL_OF_ONE
    adds_to: ClassVar[str] = LINK
    parameters: ClassVar = (
        Parameter("mass_kg", "kg"),
        Parameter("com_m", "m", size=3),
        Parameter("link", "1", size=0),
    )
    servo: ClassVar = InServo(tells_apart="a log with a known mass at the tip")

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return which link it is, its mass in the model [kg], and how far its centre may be off
        [m].
        """
        mass = float(data.recording.derived(link_masses)[joint])
        return [(joint + 1.0, mass, sd) for sd in CENTRE_SDS]

    def joints(self, data: Data) -> list[int]:
        """Return all but the last link: errors of the last are named payload."""
        return super().joints(data)[:-1]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return standard deviations about the nominal; some of the mass must remain.

        Where links were diagnosed before, odds are seven nats worse: tools change, links do not.
        """
        size = shape[1] * np.array([MASS_SD, *[shape[2]] * 3])
        low, known = np.full(4, -np.inf), data.recording.link_factor is not None
        low[0] = -(1 - LEFT) * float(data.recording.derived(link_masses)[joint])
        return Prior(size, low, np.full(4, np.inf), odds=7.0 if known else 0.0)

    def columns(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return the torque per kilogram, and per kg·m that the link is moved by, on all joints."""
        columns = data.recording.derived(body_columns, *data.gravity_found)
        return columns[..., 4 * joint : 4 * joint + 4]

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether some mass is left, and the centre is near the link."""
        was, more = float(data.recording.derived(link_masses)[joint]), float(coefficients[0])
        moved = float(np.linalg.norm(coefficients[1:])) / max(was + more, 1e-9)
        return more > -(1 - LEFT) * was and moved <= FARTHEST

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the link, and what its mass [kg] and centre [m] in its axes differ by."""
        more = float(coefficients[0])
        return {
            "link": int(shape[0]),
            "mass_kg": more,
            "com_m": [float(x) for x in coefficients[1:] / (shape[1] + more)],
        }

    def on_links(self, data: Data, joint: int, shape: Shape, size: int) -> Array:
        """Return the change of this link's parameters."""
        out = np.zeros((10 * data.n, size))
        own = inertial_parameters(data.recording.pinocchio)[joint]
        out[10 * joint : 10 * joint + 10] = link_directions(own)
        return out

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm with the other link."""
        numbers = np.array(part.coefficients)
        if numbers.shape != (4,) or not np.isfinite(numbers).all():
            raise StictionError(
                f"cause {self.name} of link {part.joint}: coefficients {numbers.tolist()}: "
                "expected mass [kg] and moment (3) [kg·m] that are added"
            )
        links, j = inertial_parameters(arm.pinocchio()), part.joint - 1
        mass = links[j, 0]
        if mass + numbers[0] <= 0:
            raise StictionError(
                f"cause {self.name} of link {part.joint}: {numbers[0]:+.4g} kg on {mass:.4g} kg "
                "leave no body: expected less"
            )
        links[j] = changed_link(links[j], numbers)
        return with_inertias(arm, links)
