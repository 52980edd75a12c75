"""A joint whose angle differs from the model's: it turns the other way, or its zero is elsewhere.

Where gravity and inertia along the logged angles do not explain the torques, nor does a body on the
flange, each joint in turn is turned round, or shifted by steps over a whole turn. All joints'
torques are fitted with each load, as in `loads`. The joint with the least Σ log(error) is named, if
that is far below, and no other joint comes near.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from stiction_envs.arrays import Array, rms
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, passive_torque, reach_of
from stiction_envs.measured.motion_thresholds import REVERSAL_SPEED
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import torque_regressor

LEAST_LOAD = 0.001
"""Least load that shows factor, sign and angle, root mean square, over the arm's weight at its
reach [-]; assumed: 0.5 N·m on a UR10, 0.2 N·m on a Panda, 0.002 N·m on an SO-101."""
MOST_ROWS = 200
"""Rows that are used, evenly spaced [-]; assumed, to limit the time."""
STEP = np.pi / 8
"""Step of the shifts to try [rad]; assumed."""
FAR = 0.4
"""Least shift that is named here [rad]; assumed: the cause `encoder_offset` finds smaller ones."""
UNEXPLAINED = 0.2
"""Error over the load of a joint, from which on the angles are doubted [-]; assumed."""
FLOOR = 0.02
"""Error over a joint's torque below which errors are alike [-]; assumed."""
BETTER = 0.7
"""Least fall of Σ log(error), over all joints, of the joint that is named [-]: half the error of
one. Assumed."""
NEXT_BEST = 0.7
"""Largest part of that fall that another joint may reach [-]; assumed."""


@dataclass(frozen=True)
class AngleError:
    """Difference between a joint's logged angle and the model's: direction, offset."""

    joint: int
    """From 1."""
    offset: float | None
    """Logged angle less the model's [rad]; None where it turns the other way."""

    def __str__(self) -> str:
        if self.offset is None:
            return f"joint {self.joint} turns the other way: its angle has the opposite sign"
        return (
            f"the zero of joint {self.joint} is off by {self.offset:.3g} rad from the model's "
            "(encoder_offset)"
        )


def least_load(model: pin.Model) -> float:
    """Return the least load of a joint that shows its factor and sign, root mean square [N·m]."""
    return LEAST_LOAD * reach_of(model) * 9.81 * sum(x.mass for x in model.inertias)


def others_of(dq: Array, ddq: Array) -> list[Array]:
    """Return by joint (T, 4) rotor, dry and viscous friction, and offset beside its load."""
    return [
        np.column_stack([a, np.tanh(v / REVERSAL_SPEED), v, np.ones(len(v))])
        for v, a in zip(dq.T, ddq.T, strict=True)
    ]


def angle_error(
    motion: tuple[Array, Array, Array], tau: Array, arm: Arm, rows: float
) -> AngleError | None:
    """Return the joint whose angle is not the model's; None without a clear one.

    Args:
        motion: (T, n) angles, speeds and accelerations.
        tau: (T, n) torques [N·m].
        arm: the nominal arm.
        rows: number of independent rows.
    """
    step = max(1, len(tau) // MOST_ROWS)
    q, dq, ddq = (x[::step] for x in motion)
    tau, others, model = tau[::step], others_of(dq, ddq), arm.pinocchio()
    floor = FLOOR * rms(tau) + 1e-9

    def errors(sign: Array, shift: Array) -> tuple[Array, Array]:
        load = inverse_dynamics(model, sign * q - shift, sign * dq, sign * ddq)
        load += passive_torque(arm, sign * q - shift)
        left = np.empty(arm.n)
        for j in range(arm.n):
            x = np.column_stack([load[:, j], others[j]])
            left[j] = np.std(tau[:, j] - x @ np.linalg.lstsq(x, tau[:, j], rcond=None)[0])
        return np.hypot(left, floor), load

    one, zero = np.ones(arm.n), np.zeros(arm.n)
    now, load = errors(one, zero)
    # a load on the flange may explain as much
    weight, tip = 1 / now, torque_regressor(model, q, dq, ddq)[..., -10:]
    blocks = [np.column_stack([load[:, j], others[j]]) * weight[j] for j in range(arm.n)]
    shared = np.concatenate([tip[:, j] * weight[j] for j in range(arm.n)])
    x, y = np.column_stack([block_diag(*blocks), shared]), (tau * weight).T.ravel()
    left = (y - x @ np.linalg.lstsq(x, y, rcond=None)[0]).reshape(arm.n, -1).std(axis=1)
    now = np.minimum(now, np.hypot(left * now, floor))
    loaded = load.std(axis=0) > least_load(model)
    if not (now[loaded] > UNEXPLAINED * load[:, loaded].std(axis=0)).any():
        return None

    def gained(sign: Array, shift: Array) -> float:
        return float(np.log(now / errors(sign, shift)[0]).sum())

    tries: list[list[tuple[float, float | None]]] = []
    for unit in np.eye(arm.n):
        tries.append([(gained(one - 2 * unit, zero), None)])
        shifts = np.arange(-np.pi + STEP, np.pi + 0.1, STEP)
        tries[-1] += [(gained(one, x * unit), x) for x in shifts]
    found = {j: max(tried, key=lambda x: x[0]) for j, tried in enumerate(tries)}
    first, second = sorted(found, key=lambda j: -found[j][0])[:2] if arm.n > 1 else (0, -1)
    gain, shift = found[first]
    # a log of seconds may fit one of so many by chance
    by_chance = (np.log(sum(map(len, tries))) + NAMED) / rows
    if gain < max(BETTER, by_chance) or (arm.n > 1 and found[second][0] > NEXT_BEST * gain):
        return None
    if shift is not None:
        unit = np.eye(arm.n)[first]
        best = minimize_scalar(
            lambda x: -gained(one, x * unit), bounds=(shift - STEP, shift + STEP), method="bounded"
        )
        shift = float(best.x)
        if abs(shift) < FAR:
            return None
    return AngleError(first + 1, shift)
