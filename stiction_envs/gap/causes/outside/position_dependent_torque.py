"""Smooth torque over the joint angle: τ = c_0 + Σ_k (a_k cos k q + b_k sin k q), k = 1 to `order`.

A cable or hose that bends, or a torque sensor that depends on the angle, has the same torque in
both directions of motion. `external_spring` is a straight line that pulls back, and
`position_dependent_friction` repeats within the joint's range. Harmonics of the whole turn predict
left-out angles as well as splines do (the iiwa's joint 3, simulated humps and waves), need no
knots, and MuJoCo holds them exactly. Where the joint has not been, nothing is known: the torque
there is that at the nearest angle of the logs.

The first harmonic is also what a wrong mass looks like on a joint that moves alone. Only other
joints that turn it against gravity distinguish the two.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording

MOST_ORDER = 3
"""Largest number of harmonics of a turn to try. A fourth never predicted left-out angles
better, of the Panda, the iiwa and simulated humps."""
DISTINCT = 1e-08
"""Least eigenvalue of the correlations of its columns for the logs to distinguish them [-];
assumed: ten times the ridge of the fits."""
ASIDE = 0.5
"""Range beyond the angles of the logs, on either side, over their span, in which the curve must be
plausible [-]; assumed."""
BEYOND = 10.0
"""Largest torque there over that at the angles of the logs, both peak to peak [-]; with more,
harmonics only cancel each other in the logs. Assumed: more than twice that of a cosine at its
crest."""


class PositionDependentTorque(Cause):
    """A cable, a hose, a sensor."""

    name: ClassVar[str] = "position_dependent_torque"
    what: ClassVar[str] = "smooth torque over the joint angle (cable, hose, sensor)"
    what_to_record: ClassVar[str] = (
        "slow sweeps over the joint's whole range, there and back, with the other joints in "
        "several poses that turn it against gravity"
    )
    is_linear: ClassVar[bool] = False
    shown_at_rest: ClassVar[bool] = True
    parameters: ClassVar = (
        Parameter("coefficients_nm", "N·m", size=7),
        Parameter("order", "1", size=0),
    )
    view: ClassVar = View(
        "joint angle [rad]", variable("q"), note="a smooth curve, the same in both directions"
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a thirtieth of what the joint can bear [N·m]; assumed."""
        free = np.full(1 + 2 * MOST_ORDER, np.inf)
        return Prior(np.full(len(free), 0.03 * data.strength[joint]), -free, free)

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return ones, then cosine and sine of each harmonic, constant beyond the logs' angles."""
        angle = data.q[:, joint]
        if len(shape) > 1:
            angle = np.clip(angle, shape[1], shape[2])
        x = harmonics(angle, int(shape[0]))
        return np.concatenate([x[:, :1], data.smooth(x[:, 1:])], axis=1)

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return orders whose harmonics differ along these angles, highest first, and the angles'
        lowest and highest."""
        rows = data.block >= 0
        out: list[Shape] = []
        low, high = float(data.q[:, joint].min()), float(data.q[:, joint].max())
        for k in range(MOST_ORDER, 0, -1):
            x = self.columns(data, joint, (float(k), low, high))[rows]
            x /= np.maximum(np.linalg.norm(x, axis=0), 1e-12)
            if np.linalg.eigvalsh(x.T @ x)[0] > DISTINCT:
                out.append((float(k), low, high))
        return out

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether harmonics do not cancel where the joint was, to be huge elsewhere."""
        low, high = data.recording.derived(usual_angles)[:, joint]
        more = ASIDE * (high - low)
        seen, wider = np.linspace(low, high, 100), np.linspace(low - more, high + more, 200)
        most = BEYOND * np.ptp(series(coefficients, seen))
        return bool(np.ptp(series(coefficients, wider)) <= most)

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return c_0, a_1, b_1, a_2, ... [N·m] and the order."""
        return {"coefficients_nm": [float(x) for x in coefficients], "order": int(shape[0])}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Take one cogging motor per harmonic, and an offset, that the motor must overcome."""
        j, (mean, *waves) = part.joint - 1, part.coefficients
        draft.values["offset"][j] += mean
        for k, (a, b) in enumerate(zip(waves[::2], waves[1::2], strict=True), start=1):
            # MuJoCo's cogging a sin(k q + φ) drives the joint
            draft.waves.append((j, float(np.hypot(a, b)), float(k), float(np.arctan2(-a, -b))))
        draft.not_in_tables.append(f"{self.name} of joint {j + 1}: in model.xml, but for its mean")
        if len(part.shape) > 1:
            low, high = part.shape[1:]
            draft.not_in_mjcf.append(
                f"{self.name} of joint {j + 1}: constant beyond {low:.3g} to {high:.3g} rad"
            )


def usual_angles(recording: Recording) -> Array:
    """Return (2, n) angles below and above which a joint hardly ever was [rad]."""
    return np.asarray(np.percentile(recording.q[recording.block >= 0], [1, 99], axis=0))


def harmonics(q: Array, order: int) -> Array:
    """Return (T, 1 + 2 order) ones, then cosine and sine of each harmonic of angles (T,)."""
    k = np.multiply.outer(q, np.arange(1, order + 1))
    waves = np.stack([np.cos(k), np.sin(k)], axis=2).reshape(len(q), -1)
    return np.concatenate([np.ones((len(q), 1)), waves], axis=1)


def series(coefficients: Array, q: Array) -> Array:
    """Return (T,) torque of coefficients (1 + 2 order,) at angles (T,) [N·m]."""
    return np.asarray(harmonics(q, len(coefficients) // 2) @ coefficients)
