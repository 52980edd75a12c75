"""Extra friction near zero speed: τ = ΔF sign(q̇) exp(−(q̇/v_s)²).

`stiction_nm` is ΔF, what is added at rest to the level in motion.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.measured.motion_thresholds import REST_SPEED

FASTEST = 0.3
"""Largest Stribeck velocity to try [rad/s]; assumed."""
COUNT = 10
"""Number of Stribeck velocities to try; assumed."""
MOST_RATIO = 5.0
"""Largest ΔF over the level in motion for which bristles are bent [-]; assumed."""


class StribeckFriction(Cause):
    """Friction that falls from its level at rest to its level in motion."""

    name: ClassVar[str] = "stribeck_friction"
    what: ClassVar[str] = "extra friction near zero speed"
    is_linear: ClassVar[bool] = False
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "slow constant speeds, from a few mrad/s up, in both directions"
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (
        Parameter("stiction_nm", "N·m", 0.0),
        Parameter("stribeck_velocity", "rad/s", 0.0, size=0),
    )
    view: ClassVar = View(
        "joint speed [rad/s]",
        variable("dq"),
        note="friction falls as the joint gets faster",
        limit=lambda shape: max(6 * shape[0], 0.02),
    )
    servo: ClassVar = InServo(
        sizes={"drop": 0.4, "stribeck_velocity": 1.0},
        starts=lambda x: [{"drop": 0.3, "stiction": 1.2 * x["stiction"]}],
        reported={"stiction_nm": (("stiction", "drop"), lambda f, s: f * s)},
        stage=1,
        of_every_joint=True,
        evidence="the joint needs more torque to start than to go on",
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the direction, faded out with speed."""
        # the reversal path has a wider filter: the speed falls fast where a joint stops
        speed = data.recording.path_rate(data.recording.reversal_path[:, joint])
        fade = np.exp(-np.square(speed / shape[0]))
        ratio = shape[1] if len(shape) > 1 else 0.0
        return data.growth(joint, fade, ratio)[:, None]

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return v_s and ΔF over the level in motion, which bends the bristles further."""
        if level <= 0:
            return shape
        return shape[0], min(float(coefficients[0]) / level, MOST_RATIO)

    def grid(self, data: Data, joint: int) -> Array:
        """Return Stribeck velocities from what a filtered log resolves to common speeds.

        A faster one would never fade along this motion: it would look constant.
        """
        top = float(np.percentile(np.abs(data.dq[:, joint]), 95))
        low = 3 * REST_SPEED
        return np.geomspace(low, min(FASTEST, top), COUNT) if top > 1.1 * low else np.empty(0)

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return those of the grid; none along slow motion."""
        return [(float(x),) for x in self.grid(data, joint)]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Raise friction at rest only."""
        draft.values["stiction"][part.joint - 1] += part.coefficients[0]
        draft.values["stribeck_velocity"][part.joint - 1] = part.shape[0]
