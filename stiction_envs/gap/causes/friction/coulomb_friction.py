"""Dry friction that is missing or wrong: τ = F_c sign(q̇), F_c in `coulomb_nm`."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import DRY, Array, Cause, Parameter, Prior, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data


class CoulombFriction(Cause):
    """A torque of constant size against the motion."""

    name: ClassVar[str] = "coulomb_friction"
    what: ClassVar[str] = "dry friction missing or wrong"
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "constant speed in both directions, at several speeds"
    adds_to: ClassVar[str] = DRY
    parameters: ClassVar = (Parameter("coulomb_nm", "N·m", 0.0),)
    view: ClassVar = View(
        "joint speed [rad/s]", variable("dq"), note="a step where the motion turns round"
    )
    servo: ClassVar = InServo(
        sizes={"stiction": 0.03},
        starts=lambda x: [{"stiction": y * x["stiffness"]} for y in (0.3 * x["error"], 0.01)],
        reported={"coulomb_nm": (("stiction", "drop"), lambda f, s: f * (1 - s))},
        odds=1.0,
        stage=0,
        of_every_joint=True,
        evidence="the joint stops short of its command, on the side from which it came",
        tells_apart="slow motion through several poses, both ways",
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a twentieth of what the joint can bear [N·m]; every joint has some; assumed."""
        odds = 1.0 if data.has_friction else -1.0
        return Prior(np.array([0.05 * data.strength[joint]]), odds=odds, everywhere=True)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the direction of motion."""
        return data.dry_friction_ratio(joint)[:, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Raise friction at rest and in motion."""
        (level,) = part.coefficients
        draft.coulomb[part.joint - 1] += level
        draft.values["stiction"][part.joint - 1] += level
