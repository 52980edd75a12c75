"""Friction that lags reversals: a bristle ζ' = (q̇ − |q̇| ζ)/d in place of sign(q̇).

It is Dahl's law; with `stribeck_friction` or damping LuGre's.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.dataset import Data

DISTANCES = np.geomspace(1e-3, 1e-3 * 50**1.25, 11)
"""Presliding distances to try [rad]; assumed: in a filtered log shorter ones look like
sign(q̇), and no gear yields over the longest, 0.13 rad."""


def since_reversal(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) how far the joint has gone since it last reversed [rad]."""
    out = np.zeros(len(data.q))
    for run in data.recording.runs:
        q = data.q[run, joint]
        sign = np.sign(np.diff(q, prepend=q[0]))
        turned = np.flatnonzero(np.diff(sign) != 0) + 1
        start = np.zeros(len(q), dtype=int)
        start[turned] = turned
        start = np.maximum.accumulate(start)
        out[run] = np.abs(q - q[start])
    return out


class PreslidingHysteresis(Cause):
    """A joint that yields before it slides."""

    name: ClassVar[str] = "presliding_hysteresis"
    what: ClassVar[str] = "friction lags reversals (bristle)"
    resembles_delay: ClassVar[bool] = True
    is_linear: ClassVar[bool] = False
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "many slow reversals of a few mrad to some tens of mrad"
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("bristle_stiffness", "N·m/rad", 0.0),)
    view: ClassVar = View(
        "way since the last reversal [rad]",
        since_reversal,
        folded=True,
        note="friction builds up over some way after a reversal",
        limit=lambda shape: 8 * shape[0],
    )
    servo: ClassVar = InServo(
        sizes={"bristle": 1.5},
        starts=lambda x: [{"bristle": 0.005}, {"bristle": 0.02}],
        reported={"bristle_stiffness": (("stiction", "bristle"), lambda f, z: f / z)},
        stage=1,
        evidence="the angle gives before it slides",
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the change by the bristle of dry friction of 1 N·m."""
        path, runs = data.recording.reversal_path[:, [joint]], data.recording.path_runs
        distance = np.array([[shape[0]]])
        ratio = bristles(path, runs, distance)[:, 0, 0]
        return (ratio - data.dry_friction_ratio(joint))[:, None]

    def grid(self, data: Data, joint: int) -> Array:
        """Return presliding distances d = F_c/σ0 [rad]."""
        return DISTANCES

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return σ0 = F_c/d [N·m/rad], F_c being the part of friction that lags."""
        return {"bristle_stiffness": float(coefficients[0]) / shape[0]}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Set the bristle's stiffness."""
        draft.values["bristle_stiffness"][part.joint - 1] = part.coefficients[0] / part.shape[0]

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether anything lags."""
        return bool(coefficients[0] > 0)
