"""Dry friction that grows with the transmitted torque: τ = k |τ_load| sign(q̇)."""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data

MOST_RATIO = 1.0
"""Largest k over the level [1/(N·m)], for little friction without load; assumed."""


class LoadDependentFriction(Cause):
    """Friction of gear and bearing under load."""

    name: ClassVar[str] = "load_dependent_friction"
    what: ClassVar[str] = "friction grows with transmitted torque"
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = (
        "the same slow motion in poses of small and of large gravity torque"
    )
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("load_coefficient", "1", 0.0, 1.0),)
    view: ClassVar = View(
        "transmitted torque [N·m]",
        lambda data, joint, shape: np.abs(data.rigid[:, joint]),
        folded=True,
        note="friction grows with load",
    )
    servo: ClassVar = InServo(
        sizes={"load": 0.3},
        starts=lambda x: [
            {"load": 0.5 * x["stiction"] / x["gravity"], "stiction": 0.5 * x["stiction"]}
        ],
        stage=1,
        of_every_joint=True,
        of_gravity=True,
        evidence="the joint stops shorter where gravity is larger",
    )

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return no bend yet, and the mean load, at which presliding distances were measured.

        Presliding distances of a nominal model's friction belong to the level without load.
        """
        mean = 0.0 if data.has_friction else float(np.abs(data.rigid[:, joint]).mean())
        return [(0.0, mean)]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return the coefficient of a dry gear [-]; assumed."""
        return Prior(np.array([0.1]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the load's size in the direction of motion."""
        ratio, mean = shape or (0.0, 0.0)
        more = data.growth(joint, np.abs(data.rigid[:, joint]) - mean, ratio)
        return (mean * data.dry_friction_ratio(joint) + more)[:, None]

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return k over the level at the mean load [1/(N·m)], which bends the bristles."""
        mean, k = (shape or (0.0, 0.0))[1], float(coefficients[0])
        there = level + k * mean
        return (min(k / there, MOST_RATIO), mean) if there > 0 else shape

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Let friction grow in the tables; MJCF holds the level at the mean load."""
        j, k = part.joint - 1, part.coefficients[0]
        draft.load[j] += k
        stands = k * draft.mean_load[j]
        draft.leave_out(part, "the level at the logs' mean load stands", tables=False, dry=stands)
