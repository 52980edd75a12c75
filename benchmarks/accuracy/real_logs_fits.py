"""Held-out fits besides the tool's: usual ones, masses alone, and a robot without a model.

All are linear least squares, each block of time under the fit of all others.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin

from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import torque_regressor

WRIST = (4, 5)
"""Joints of the TX40 (from 0) that one motor drives together: each sees the other's friction."""


def held_out(data: Data, columns: list[np.ndarray], target: np.ndarray) -> np.ndarray:
    """Root mean square (n,) [N·m] that columns (T, k) of each joint leave of a target (T, n)."""
    out = np.zeros(data.n)
    for j, x in enumerate(columns):
        y, left, count = target[:, j], 0.0, 0
        for b in range(data.blocks):
            test, fit = data.block == b, (data.block >= 0) & (data.block != b)
            c = np.linalg.lstsq(x[fit], y[fit], rcond=1e-8)[0] if x.shape[1] else np.zeros(0)
            left += float(np.sum((y[test] - x[test] @ c) ** 2))
            count += int(test.sum())
        out[j] = np.sqrt(left / count)
    return out


def usual(d: Diagnosis) -> dict[str, np.ndarray]:
    """Rigid body, plus Coulomb and viscous friction, plus an offset: (n,) each [N·m].

    Given published masses, whatever the baseline of the tool was.
    """
    data = d.base
    one = np.ones((len(data.t), 1))
    friction = [
        np.column_stack([data.smooth(data.direction(j)), data.dq[:, j]]) for j in range(data.n)
    ]
    moves = [np.ptp(data.q[:, j]) > 0.2 for j in range(data.n)]
    friction = [x if m else x[:, :0] for x, m in zip(friction, moves, strict=True)]
    return {
        "rigid": held_out(data, [one[:, :0]] * data.n, data.residual),
        "coulomb_viscous": held_out(data, friction, data.residual),
        "coulomb_viscous_offset": held_out(
            data, [np.hstack([x, one]) for x in friction], data.residual
        ),
    }


def masses(d: Diagnosis) -> dict[str, np.ndarray]:
    """Poses: what offsets, and any masses of all links with offsets, leave: (n,) each [N·m].

    All links' masses and centres of mass are free, shared by all joints.
    """
    data = d.data
    one = np.ones((len(data.t), 1))
    out = {
        "rigid": held_out(data, [one[:, :0]] * data.n, data.residual),
        "offset": held_out(data, [one] * data.n, data.residual),
        "offset_scale": held_out(
            data,
            [np.hstack([one, data.nominal[:, [j]]]) for j in range(data.n)],
            data.residual,
        ),
    }
    static = torque_regressor(data.pinocchio, data.q, 0 * data.q, 0 * data.q)
    out["any_masses"] = held_out_together(data, static, data.residual)
    return out


def together(
    data: Data, shared: np.ndarray, target: np.ndarray, rows: np.ndarray, friction: bool
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Fit shared parameters (P,) and each joint's own; both least squares, joints by their size."""
    scale = target[rows].std(axis=0) + 1e-9
    own = [_own(data, j, friction) for j in range(data.n)]
    ends = np.cumsum([shared.shape[2], *(x.shape[1] for x in own)])
    xx, xy = np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
    for j in range(data.n):
        x = np.zeros((int(rows.sum()), ends[-1]))
        x[:, : ends[0]], x[:, ends[j] : ends[j + 1]] = shared[rows, j], own[j][rows]
        xx += x.T @ x / scale[j] ** 2
        xy += x.T @ target[rows, j] / scale[j] ** 2
    # dependent parameters take the smallest values that do
    c = np.linalg.pinv(xx, rcond=1e-9, hermitian=True) @ xy
    return c[: ends[0]], np.split(c[ends[0] :], ends[1:-1] - ends[0])


def _own(data: Data, j: int, friction: bool) -> np.ndarray:
    """Offset and rotor inertia of a joint, the wrist's other motor, own dry, viscous friction."""
    columns = [np.ones(len(data.t)), data.ddq[:, j]]
    if data.n == len(AXES) and j in WRIST:
        (k,) = (k for k in WRIST if k != j)
        columns += [data.ddq[:, k], data.smooth(data.direction(k)), data.dq[:, k]]
    if friction:
        columns += [data.smooth(data.direction(j)), data.dq[:, j]]
    return np.stack(columns, axis=1)


def held_out_together(
    data: Data, shared: np.ndarray, target: np.ndarray, friction: bool = False
) -> np.ndarray:
    """As `held_out`, with parameters that all joints share."""
    left, count = np.zeros(data.n), 0
    for b in range(data.blocks):
        test, fit = data.block == b, (data.block >= 0) & (data.block != b)
        c, own = together(data, shared, target, fit, friction)
        for j in range(data.n):
            e = target[test, j] - shared[test, j] @ c - _own(data, j, friction)[test] @ own[j]
            left[j] += float(e @ e)
        count += int(test.sum())
    return np.sqrt(left / count)


# ---- Stäubli TX40 ----------------------------------------------------------------------------


# a(i-1) [m], alpha(i-1) [rad], d(i) [m], zero of theta(i) [rad]: modified Denavit-Hartenberg
# parameters of the TX40, from its instruction manual's lengths
AXES = (
    (0.0, 0.0, 0.32, 0.0),
    (0.0, -np.pi / 2, 0.035, 0.0),
    (0.225, 0.0, 0.0, 0.0),
    (0.0, np.pi / 2, 0.225, 0.0),
    (0.0, -np.pi / 2, 0.0, 0.0),
    (0.0, np.pi / 2, 0.065, 0.0),
)


def tx40_arm() -> Arm:
    """The TX40's axes, with next to no masses: none are published."""
    text = '<mujoco model="tx40"><compiler angle="radian"/><worldbody>'
    for i, (a, alpha, d, theta) in enumerate(AXES, 1):
        place = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0, 0])) * pin.SE3(
            pin.utils.rotate("z", theta), np.array([0, 0, d])
        )
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        at = " ".join(f"{v:.9g}" for v in place.translation)
        text += (
            f'<body name="link{i}" pos="{at}" quat="{w:.9g} {x:.9g} {y:.9g} {z:.9g}">'
            '<inertial pos="0 0 0" mass="0.001" diaginertia="1e-6 1e-6 1e-6"/>'
            f'<joint name="joint{i}" axis="0 0 1" range="-4.8 4.8"/>'
        )
    text += '<site name="flange"/>' + "</body>" * len(AXES) + "</worldbody></mujoco>"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tx40.xml"
        path.write_text(text)
        return load_arm(path)


def without_body(log: JointLog, arm: Arm) -> tuple[JointLog, dict[str, np.ndarray]]:
    """The log less a rigid body that was fitted to it with its friction, and what fits leave.

    No masses of this robot are published; those fitted here need not be any body's.
    """
    data = assemble(arm, prepare([log]))
    shared = torque_regressor(data.pinocchio, data.q, data.dq, data.ddq)
    out = {
        "rigid": held_out_together(data, shared, data.tau),
        "coulomb_viscous": held_out_together(data, shared, data.tau, friction=True),
    }
    c, own = together(data, shared, data.tau, data.block >= 0, friction=True)
    # what is left to be diagnosed is the offset and the joint's own friction
    body = np.empty_like(data.tau)
    for j in range(data.n):
        x, mine = _own(data, j, True), own[j].copy()
        mine[[0, len(mine) - 2, len(mine) - 1]] = 0.0
        body[:, j] = shared[:, j] @ c + x @ mine
    inside = (log.t >= data.t[0]) & (log.t <= data.t[-1])
    fitted = np.stack([np.interp(log.t[inside], data.t, x) for x in body.T], axis=1)
    made = dataclasses.replace(
        log, t=log.t[inside], q=log.q[inside], tau=log.tau[inside] - fitted, breaks=()
    )
    return made, out
