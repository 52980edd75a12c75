"""Torque that repeats with the joint angle: τ = a sin(k q + φ).

A gear's or motor's ripple pushes the same way in both directions; friction that is uneven turns
with the motion: τ = a sin(k q + φ) sign(q̇).
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data

RIDGE = 1e-9 * np.eye(5)
"""Keeps the system solvable where waves do not differ [-]; assumed, far below any effect."""
LEAST_PERIODS = 1.25
"""Least number of ripple periods within the range of a joint [-]; assumed."""
ROWS = 3000
"""Number of rows from which the periods are found; assumed."""
BEST = 3
"""Number of periods of each kind that go on to the selection; assumed."""
AT_ONCE = 256
"""Number of rows of which waves are computed at once: they stay in the processor's cache."""


def phase(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) phase of a joint within one period of its ripple, in periods [-]."""
    return np.mod(shape[0] * data.q[:, joint] / (2 * np.pi), 1.0)


class PositionDependentFriction(Cause):
    """Ripple of gear, bearing or motor."""

    name: ClassVar[str] = "position_dependent_friction"
    what: ClassVar[str] = "ripple with joint angle"
    is_linear: ClassVar[bool] = False
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = (
        "slow constant speed over a quarter turn or more, there and back"
    )
    parameters: ClassVar = (
        Parameter("ripple_nm", "N·m", size=2),
        Parameter("periods_per_rev", "1/rev", 0.0, size=0),
        Parameter("phase_rad", "rad", size=0),
    )
    view: ClassVar = View(
        "joint angle, part of one ripple period [-]", phase, note="a sine, once per period"
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a hundredth of what the joint can bear [N·m]; assumed."""
        return Prior(np.full(2, 0.01 * data.strength[joint]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return sine and cosine of k q, in the direction of motion if it is friction's."""
        angle = shape[0] * data.recording.reversal_path[:, joint]
        wave = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        if len(shape) > 1:
            wave *= data.directions[:, [joint]]
        return wave

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the periods per turn, whole numbers, that the residual shows best.

        They range from `LEAST_PERIODS` within the joint's range to what its speed and the sampling
        resolve. Only peaks count: what explains ever more towards fewer periods is no ripple.
        """
        q = data.q[:, joint]
        span = float(np.ptp(q))
        if span < 1e-3:
            return []
        step = float(np.percentile(np.abs(data.dq[:, joint]), 75)) * data.recording.path_dt
        low = max(1, int(np.ceil(LEAST_PERIODS * 2 * np.pi / span)))
        high = min(400, int(2 * np.pi / max(8 * step, 1e-6)))
        if low > high:
            return []
        count = np.arange(1, high + 1)
        # each angle has the same weight, however long the joint stays there
        thin = slice(None, None, max(1, len(q) // ROWS))
        weight = np.abs(data.dq[thin, joint])
        weight = np.sqrt(np.minimum(weight, np.percentile(weight, 90)))
        direction = data.directions[:, joint][data.recording.path_rows]
        base = np.stack([np.ones_like(q), q, direction], axis=1)[thin]
        base, r = base * weight[:, None], residual[thin] * weight
        turning = weight * direction[thin]
        found: list[Shape] = []
        for side, tail in ((weight, ()), (turning, (1.0,))):
            power = _shown(q[thin], len(count), side, base, r)
            around = np.concatenate([[-np.inf], power, [-np.inf]])
            peak = (power >= around[:-2]) & (power > around[2:]) & (count >= low)
            best = np.argsort(np.where(peak, -power, np.inf), kind="stable")[:BEST]
            found += [(float(count[k]), *tail) for k in best if peak[k]]
        return found

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return a [N·m], k [1/rev], φ [rad]."""
        size, periods, angle = self._wave(coefficients, shape)
        return {"ripple_nm": size, "periods_per_rev": periods, "phase_rad": angle}

    @staticmethod
    def _wave(c: Array, shape: Shape) -> tuple[float, float, float]:
        return float(np.hypot(*c)), shape[0], float(np.arctan2(c[1], c[0]))

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Add to the joint's cogging, or take another motor's where that has other periods."""
        j = part.joint - 1
        if len(part.shape) > 1:
            draft.leave_out(part, "MuJoCo's ripple does not turn with the motion")
            return
        size, periods, angle = self._wave(np.array(part.coefficients), part.shape)
        # MuJoCo's cogging drives the joint; ours is what the motor must overcome
        angle += np.pi
        ripple = [draft.values[f"ripple_{x}"] for x in ("amplitude", "periods", "phase")]
        there, its_periods, its_angle = (x[j] for x in ripple)
        if there == 0 or periods == its_periods:
            if there:
                both = there * np.exp(1j * its_angle) + size * np.exp(1j * angle)
                size, angle = abs(both), np.angle(both)
            for mine, x in zip(ripple, (size, periods, angle), strict=True):
                mine[j] = x
        else:
            draft.waves.append((j, size, periods, angle))
            draft.not_in_tables.append(
                f"{part.cause} of {part.where}: {periods:g} periods per turn are in model.xml; the "
                "tables hold one ripple per joint"
            )


def _shown(q: Array, count: int, side: Array, base: Array, r: Array) -> Array:
    """Return (K,) squared error that waves of 1 to K periods per turn explain, each with others.

    Args:
        q: (T,) angle [rad].
        count: K.
        side: (T,) weight of the waves, with the sign of the motion where they are friction's.
        base: (T, 3) weighted other columns.
        r: (T,) weighted residual.
    """
    columns = np.column_stack([base, r])
    once, twice = np.zeros((count, 4), dtype=complex), np.zeros(count, dtype=complex)
    for start in range(0, len(q), AT_ONCE):
        rows = slice(start, start + AT_ONCE)
        # e^(ikq) for all k by multiplication: sines of all waves would take most of the time
        waves = np.exp(1j * q[None, rows])
        while len(waves) < count:
            waves = np.concatenate([waves, waves * waves[-1]])[:count]
        once += waves @ (columns[rows] * side[rows, None])
        twice += np.square(waves) @ np.square(side[rows])
    xx, xr = np.empty((count, 5, 5)), np.empty((count, 5))
    size = float(side @ side)
    xx[:, 0, 0], xx[:, 1, 1] = (size - twice.real) / 2, (size + twice.real) / 2
    xx[:, 0, 1] = xx[:, 1, 0] = twice.imag / 2
    for i, part in enumerate((once.imag, once.real)):
        xx[:, i, 2:] = xx[:, 2:, i] = part[:, :3]
        xr[:, i] = part[:, 3]
    xx[:, 2:, 2:], xr[:, 2:] = base.T @ base, base.T @ r
    solved = np.linalg.solve(xx + RIDGE, xr[..., None])[..., 0]
    return np.asarray(np.einsum("kp,kp->k", xr, solved))
