"""Something outside that pulls with position: τ = k (q − q_0)."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data

USUAL = 1e-3
"""Pull of an arm's own cables per radian, over what the joint can bear [1/rad]; assumed."""


class ExternalSpring(Cause):
    """A cable, a hose, a contact."""

    name: ClassVar[str] = "external_spring"
    what: ClassVar[str] = "cable, hose or contact that pulls with position"
    what_to_record: ClassVar[str] = (
        "static poses over the joint's whole range, other joints elsewhere"
    )
    shown_at_rest: ClassVar[bool] = True
    parameters: ClassVar = (
        Parameter("stiffness_nm_per_rad", "N·m/rad", 0.0),
        Parameter("rest_rad", "rad"),
    )
    view: ClassVar = View("joint angle [rad]", variable("q"), note="a slope: a pull with position")

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a third of what the joint can bear, at one radian [N·m/rad, N·m]; assumed.

        Springs that balance an arm carry most of its weight. They pull back from any rest angle. So
        do the cables of every arm, a little.
        """
        low, high = np.array([0.0, -np.inf]), np.full(2, np.inf)
        strength = float(data.strength[joint])
        return Prior(np.full(2, strength / 3), low, high, usual=USUAL * strength)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the angle, and ones."""
        q = data.q[:, joint]
        return np.stack([q, np.ones_like(q)], axis=1)

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return k [N·m/rad] and q_0 [rad]."""
        k = max(float(coefficients[0]), 1e-9)
        return {"stiffness_nm_per_rad": k, "rest_rad": -float(coefficients[1]) / k}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Pull from the world; several springs are one."""
        j, c = part.joint - 1, part.coefficients
        k = c[0]
        if k <= 0:
            draft.leave_out(part, "MuJoCo's springs pull back")
            return
        stiffness, middle = draft.pull[j]
        draft.pull[j] = stiffness + k, (stiffness * middle - c[1]) / (stiffness + k)
        draft.not_in_tables.append(f"{self.name} of joint {j + 1}: in model.xml")
