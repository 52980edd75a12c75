"""Links that differ a little from the model, all of them: cables, flanges, tolerances of CAD.

Random effects: in every model, with a prior, and never named. A cause is named if it stands out of
them.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.base import (
    ALL_LINKS,
    THE_ARM,
    Array,
    Cause,
    Columns,
    Parameter,
    Prior,
    Shape,
)
from stiction_envs.gap.causes.body.bodies import body_columns, link_basis
from stiction_envs.gap.causes.draft import Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters


class LinkTolerances(Cause):
    """Mass, centre and inertia of every link, J' = A J Aᵀ about its centre.

    The columns are the directions of the links' parameters that the motion shows, each of one
    standard deviation of the prior (`link_basis`).
    """

    name: ClassVar[str] = "link_tolerances"
    what: ClassVar[str] = "links within their tolerance"
    what_to_record: ClassVar[str] = "an exciting motion of all joints"
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = THE_ARM
    adds_to: ClassVar[str] = ALL_LINKS
    parameters: ClassVar = (Parameter("mass_kg", "kg"), Parameter("com_m", "m", size=3))

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return one standard deviation of each direction."""
        one = np.ones(data.recording.derived(link_basis).shape[1])
        return Prior(one, -np.inf * one, np.inf * one, usual=1.0)

    def columns(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return the torque per standard deviation of each direction."""
        columns = data.recording.derived(body_columns, *data.gravity_found)
        return columns[..., 4 * data.n + 10 :]

    def on_links(self, data: Data, joint: int, shape: Shape, size: int) -> Array:
        """Return the directions."""
        return data.recording.derived(link_basis)

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm with all links changed.

        Raises:
            StictionError: as of `with_inertias`, or another number of coefficients.
        """
        more = np.array(part.coefficients)
        if more.shape != (10 * arm.n,) or not np.isfinite(more).all():
            raise StictionError(
                f"cause {self.name}: {more.size} coefficients: expected {10 * arm.n} finite numbers"
            )
        links = inertial_parameters(arm.pinocchio())
        return with_inertias(arm, links + more.reshape(-1, 10))
