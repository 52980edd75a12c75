"""Friction that lags reversals: a bristle ζ' = (q̇ − |q̇| ζ)/d in place of sign(q̇).

Two laws are rivals on each joint: one bristle (Dahl's; with `stribeck_friction` or damping LuGre),
and Maxwell-slip elements in parallel (the presliding of GMS). After full reversals they are the
same; small reversals tell them apart. `elements` says which law fits better.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.maxwell_slip import ELEMENTS, maxwell_slip

DISTANCES = np.geomspace(1e-3, 1e-3 * 50**1.25, 11)
"""Presliding distances that are tried [rad]; assumed: in a filtered log shorter ones look like
sign(q̇), and no gear yields over the longest, 0.13 rad."""
CLEARLY = 0.9
"""Squared residual that elements leave over that of a bristle, below which they are tried [-];
assumed: sensor noise and other causes are in both."""
FALLING_SPEED = 0.1
"""Speed scale with which friction may fall where laws are compared [rad/s]; assumed."""


def since_reversal(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) how far the joint has gone since it last reversed [rad]."""
    out = np.zeros(len(data.t))
    for run in data.runs():
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
    what_to_record: ClassVar[str] = "many slow reversals of a few mrad to some tens of mrad"
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (
        Parameter("bristle_stiffness", "N·m/rad", 0.0),
        Parameter("elements", "1", size=0),
    )
    view: ClassVar = View(
        "way since the last reversal [rad]",
        since_reversal,
        folded=True,
        note="friction builds up over some way after a reversal",
        limit=lambda shape: 8 * shape[0],
    )

    def size(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return a twentieth of what the joint can bear [N·m]; assumed."""
        return np.array([0.05 * data.strength[joint]])

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return what the law adds to dry friction of 1 N·m."""
        lag = _ratio(data, joint, shape) - data.dry_friction_ratio(joint)
        return data.smooth(lag)[:, None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return presliding distances d = F_c/σ0 [rad] of a bristle, and the best of elements.

        Elements are tried only where they clearly leave less of the residual, whatever friction
        does over speed. The second number of a shape is how many there are; a bristle has none.
        """
        rows, plain = data.block >= 0, data.dry_friction_ratio(joint)
        path, motion = data.reversal_path[:, [joint]], data.settings.motion
        runs = data.recording.path_runs
        laws = (
            bristles(path, runs, DISTANCES[None], motion, data.recording.path_dt)[:, 0],
            maxwell_slip(path[:, 0], runs, DISTANCES, motion),
        )
        falls = np.exp(-np.abs(data.recording.path_rate(path[:, 0])) / FALLING_SPEED)
        known = data.smooth(np.stack([plain, plain * falls], axis=1))[rows]
        axes = np.linalg.qr(known)[0]
        r = residual[rows] - axes @ (axes.T @ residual[rows])
        left = []
        for zeta in laws:
            x = data.smooth(zeta - plain[:, None])[rows]
            x -= axes @ (axes.T @ x)
            shown = np.square(r @ x) / np.maximum(np.square(x).sum(axis=0), 1e-300)
            left.append(float(r @ r) - shown)
        out: list[Shape] = [(float(d),) for d in DISTANCES]
        if left[1].min() < CLEARLY * left[0].min():
            at = int(np.argmin(left[1]))
            near = DISTANCES[max(at - 1, 0) : at + 2]
            out += [(float(d), float(ELEMENTS)) for d in near]
        return out

    def between(self, shape: Shape, shapes: list[Shape]) -> tuple[float, float]:
        """Return the neighbouring distances, whatever the law."""
        at = int(np.argmin(np.abs(np.log(DISTANCES / shape[0]))))
        last = len(DISTANCES) - 1
        return float(DISTANCES[max(at - 1, 0)]), float(DISTANCES[min(at + 1, last)])

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return σ0 = F_c/d [N·m/rad], F_c being the part of friction that lags, and the law."""
        elements = int(shape[1]) if len(shape) > 1 else 1
        return {"bristle_stiffness": float(coefficients[0]) / shape[0], "elements": elements}

    def assumption(self, data: Data, shape: Shape) -> str:
        """Return the law that fits better; it is that of the first joint named."""
        if len(shape) > 1:
            return "friction law: Maxwell-slip elements in parallel, GMS"
        return "friction law: one bristle, Dahl's or LuGre's"

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Set the bristle's stiffness."""
        draft.bristle[part.joint - 1] = part.coefficients[0] / part.shape[0]
        if len(part.shape) > 1:
            draft.leave_out(part, "one bristle in place of parallel elements: small loops differ")

    def held(self, draft: ModelDraft, part: Part, data: Data) -> Array | None:
        """Return the torque of a bristle with the same full reversals."""
        columns = self.columns(data, part.joint - 1, part.shape[:1])
        return np.asarray(columns @ np.array(part.coefficients))

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Return whether nothing lags; the damping may be zero."""
        return bool(coefficients[0] <= 0)


def _ratio(data: Data, joint: int, shape: Shape) -> Array:
    """Return (F,) friction of a law over its steady level, unfiltered [-]."""
    path, motion = data.reversal_path[:, [joint]], data.settings.motion
    runs = data.recording.path_runs
    if len(shape) > 1:
        return maxwell_slip(path[:, 0], runs, np.array(shape[:1]), motion)[:, 0]
    dt = data.recording.path_dt
    return bristles(path, runs, np.array([[shape[0]]]), motion, dt)[:, 0, 0]
