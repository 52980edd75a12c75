"""Torques logged without the gravity that the controller adds: τ_logged = τ − s g(q).

A controller that compensates gravity by itself often logs the torque that was asked of it, and not
what the motors do (Franka's ``tau_J_d`` has no gravity, ``tau_J`` has all of it). What is missing
is the gravity of the controller's model, which is taken to be the nominal one.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import THE_ARM, Array, Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data

LEAST = 0.005
"""Share that does not count [-]; assumed: the error of usual torque gains."""
WHOLE = 0.98
"""Share from which all of gravity is missing [-]; assumed: less is the error of its model."""


class GravityCompensationMissing(Cause):
    """A share of the nominal gravity torque that the log lacks, one for all joints."""

    name: ClassVar[str] = "gravity_compensation_missing"
    what: ClassVar[str] = "torques logged without the gravity that the controller adds"
    what_to_record: ClassVar[str] = (
        "static poses of large and small gravity torque, and the measured torque beside the "
        "commanded one"
    )
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = THE_ARM
    parameters: ClassVar = (Parameter("share", "1", 0.0, 1.0),)
    view: ClassVar = View(
        "gravity torque [N·m]",
        lambda data, joint, shape: data.recording.gravity[:, joint],
        note="a slope: minus the share that is missing, the same on all joints",
    )
    servo: ClassVar = InServo(
        sizes={"compensation": 0.7},
        starts=lambda x: [{"compensation": 0.5}, {"compensation": 1.0}],
        stage=2,
        of_gravity=True,
        of_known_servo=True,
        evidence="the arm sags as if its controller added more or less gravity",
        alike=("servo_stiffness", "payload"),
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return all of it [-]."""
        return Prior(np.array([1.0]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return minus the nominal gravity torque."""
        return -data.recording.gravity[..., None]

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether a share is missing; all of it may be."""
        return float(coefficients[0]) >= LEAST

    def describe(self, data: Data, coefficients: Array, shape: Shape) -> str:
        """Return whether all of gravity is missing, or how much."""
        share = float(coefficients[0])
        if share >= WHOLE:
            return f"{self.what}: all of it"
        return f"{self.what}: {100 * share:.3g} % of it"

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say what to add: it is the log that is wrong, not the arm."""
        share = part.coefficients[0]
        draft.leave_out(
            part,
            f"add {share:.4g} of the gravity torque to the logged torque (or replay it with "
            f'gravcomp="{share:.4g}" on all bodies)',
        )
