"""Extra friction near zero speed: τ = ΔF sign(q̇) exp(−(q̇/v_s)²)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, log_grid
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.motion import along_runs, lacks_both_directions, moving
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.causes.view import View, speed
from stiction_envs.gap.signals.dataset import Data

FASTEST = 0.3
"""Stribeck velocity, as far as the joint is ever as fast [rad/s]."""
COUNT = 10
"""Stribeck velocities from what a filtered log resolves to the fastest."""
MOST_RATIO = 5.0
"""ΔF over the level in motion past which bristles are taken as at this [-]."""


class StribeckFriction(Cause):
    """Friction that falls from its level at rest to its level in motion."""

    name: ClassVar[str] = "stribeck_friction"
    what: ClassVar[str] = "extra friction near zero speed"
    approximate: ClassVar[bool] = True
    is_linear: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "slow constant speeds, from a few mrad/s up, in both directions"
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (
        Parameter("stiction_nm", "N·m", 0.0),
        Parameter("stribeck_velocity", "rad/s", 0.0, size=0),
    )
    view: ClassVar = View(
        "joint speed [rad/s]",
        speed,
        note="friction falls as the joint gets faster",
        limit=lambda shape: max(6 * shape[0], 0.02),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the direction, faded out with speed."""
        # of the reversal path, whose filter is wider: the speed falls fast where a joint stops
        speed = along_runs(data, data.reversal_path[:, joint])
        fade = np.exp(-np.square(speed / shape[0]))
        ratio = shape[1] if len(shape) > 1 else 0.0
        return data.smooth(data.growth(joint, fade, ratio))[:, None]

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return v_s and ΔF over the level in motion, which bends the bristles further."""
        if level <= 0:
            return shape
        return shape[0], min(float(coefficients[0]) / level, MOST_RATIO)

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return Stribeck velocities from what a filtered log resolves to speeds that are common.

        Motion that is slower than that never leaves the effect behind: it is as good as constant.
        """
        top = float(np.percentile(np.abs(data.dq[:, joint]), 95))
        low = 3 * data.settings.motion.rest_speed
        return log_grid(low, min(FASTEST, top), COUNT) if top > 1.1 * low else []

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return what is added at rest to the level in motion [N·m], and v_s [rad/s]."""
        return {"stiction_nm": float(coefficients[0]), "stribeck_velocity": shape[0]}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Raise friction at rest alone."""
        draft.stiction[part.joint - 1] += part.coefficients[0]
        draft.stribeck[part.joint - 1] = part.shape[0]

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether slow or fast motion is missing."""
        v, s = np.abs(data.dq[:, joint]), data.settings.motion
        if not (missing := lacks_both_directions(data, joint)):
            if ((v > s.rest_speed) & (v < s.slow_speed)).mean() < s.slow_share:
                missing = f"joint {joint + 1} never moves slowly"
            elif moving(data, joint).mean() < s.moving_share:
                missing = f"joint {joint + 1} hardly moves"
        return missing
