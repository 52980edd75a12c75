"""What acts on each joint of an arm along logs of its motion, and where the arm touches something.

A joint in contact stands far from its command and stalls.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.filters import lowpass
from stiction_envs.gap.servo.joint import CUTOFF_HZ, JointMotion, command_nodes
from stiction_envs.gap.servo.questions import resolution_of
from stiction_envs.gap.signals.reversals import angle_noise
from stiction_envs.measured.logs.corrections import runs
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

LOST = 2.0
"""What that band may lose of an angle over the noise of the angle [-]; assumed: the noise is known
to about a factor of two, and a wider band has noisier accelerations."""
WIDER = 1.25
"""Each bandwidth that is tried over the one before [-]; assumed."""
TILT = 1e-3
"""Angle over which the slope of gravity is taken [rad]; assumed."""
OUTSIDE = 1.0
"""Time for which a command counts as held before and after a segment [s]; assumed."""

FAR_OFF = 8.0
"""Least error of the fitted model in contact, over its usual size [-]; assumed."""
STRETCHED, ELSEWHERE = 1.3, 99.0
"""Least distance from the command in contact over this percentile [%] elsewhere [-]; assumed."""
SUSPECT, USUAL = 3.0, 85.0
"""Distance from the command that is suspected over this percentile [%] of all [-]; assumed."""
STALLED, MOVING = 0.1, 75.0
"""Largest speed in contact over the mean of those above this percentile [%] [-]; assumed."""
AROUND = 0.5
"""Time left out before and after a contact [s]; assumed."""
MOST_IN_CONTACT = 0.4
"""Largest share of the rows: more is no contact but another cause [-]; assumed."""


def segments(logs: Sequence[ServoLog]) -> list[tuple[int, slice]]:
    """Return the segments that have a duration: number of the log, rows."""
    return [(k, s) for k, log in enumerate(logs) for s in log.segments if s.stop - s.start > 1]


def joint_motions(
    arm: Arm, logs: Sequence[ServoLog], zeros: Array | float = 0.0
) -> list[JointMotion]:
    """Return the motion of each joint along all segments of the logs.

    The arm is rigid, and gravity acts on it. ``zeros`` (n,) are offsets of the logged angles [rad].
    """
    parts = [(logs[k], s) for k, s in segments(logs)]
    torques = [_torques(arm, log.t[s], log.q[s] - zeros) for log, s in parts]
    t = [log.t[s] for log, s in parts]
    bounds = np.concatenate([[0], np.cumsum([len(x) for x in t])])
    out = []
    for j in range(arm.n):
        commands = [log.q_cmd[s, j] for log, s in parts]
        nodes = [
            command_nodes(x, command, x[0] - OUTSIDE, x[-1] + OUTSIDE)
            for x, command in zip(t, commands, strict=True)
        ]
        gravity, slope, inertia, coupling = (
            np.concatenate([x[i][:, j] for x in torques]) for i in range(4)
        )
        out.append(
            JointMotion(
                t=np.concatenate(t),
                q=np.concatenate([log.q[s, j] for log, s in parts]),
                command=np.concatenate(commands),
                bounds=bounds,
                nodes=np.concatenate(nodes, axis=1),
                gravity=gravity,
                slope=slope,
                inertia=inertia,
                coupling=coupling,
            )
        )
    return out


def smooth(t: Array, q: Array) -> Array:
    """Return a joint's angle (T,) in the least band that loses about as much as its noise [rad].

    The noise is that of the encoder's steps, of the signal, and of stamps that jitter.
    """
    step = np.diff(t)
    jitter = float(np.std(step) / np.sqrt(2.0) * np.sqrt(np.mean((np.diff(q) / step) ** 2)))
    noise = max(resolution_of(q) / np.sqrt(12.0), angle_noise(q), jitter)
    rate, cutoff = 1.0 / float(np.median(step)), CUTOFF_HZ
    out = lowpass(q, rate, cutoff)
    while np.mean((q - out) ** 2) > (LOST * noise) ** 2:
        cutoff *= WIDER
        out = lowpass(q, rate, cutoff)
    return out


def _torques(arm: Arm, t: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return gravity, its slope, diagonal inertia, coupling torque along one segment, (T, n)."""
    model = arm.model()
    data = mujoco.MjData(model)
    n = arm.n
    speed = np.gradient(np.stack([smooth(t, x) for x in q.T], axis=1), t, axis=0)
    acceleration = np.gradient(speed, t, axis=0)
    gravity, slope, inertia, coupling = (np.empty((len(t), n)) for _ in range(4))
    mass = np.empty((n, n))
    for k in range(len(t)):
        data.qpos[:], data.qvel[:] = q[k], speed[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        bias = data.qfrc_bias.copy()
        data.qvel[:] = 0.0
        gravity[k] = _gravity(model, data)
        inertia[k] = np.diag(mass)
        coupling[k] = bias - gravity[k] + mass @ acceleration[k] - inertia[k] * acceleration[k]
        for j in range(n):
            data.qpos[j] += TILT
            slope[k, j] = (_gravity(model, data)[j] - gravity[k, j]) / TILT
            data.qpos[j] = q[k, j]
    return gravity, slope, inertia, coupling


def _gravity(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the (n,) gravity torque at rest at ``data.qpos`` [N·m]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)  # at rest: what the last speeds left would count
    out = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, out)
    return out


def suspected(motion: JointMotion) -> Bools:
    """Return (T,) rows in which a joint stands much further from its command than usually.

    They would bend a fit to all rows, and are judged by one to the others.
    """
    stretched = np.abs(motion.command - motion.q)
    return np.asarray(stretched > SUSPECT * np.percentile(stretched, USUAL))


def in_contact(motion: JointMotion, error: Array, resolution: float) -> Bools:
    """Return (T,) rows in which a joint seems to touch something or to stand at a stop.

    ``error`` (T,) is the measured angle less that of a model fitted without suspected rows [rad],
    ``resolution`` the step of the measured angle [rad].
    """
    usual = max(1.4826 * float(np.median(np.abs(error - np.median(error)))), resolution)
    stretched = np.abs(motion.command - motion.q)
    off = np.abs(error) > FAR_OFF * usual
    if not off.any() or off.mean() > MOST_IN_CONTACT:
        return np.zeros(len(error), dtype=bool)
    speed = np.abs(np.gradient(motion.q, motion.t))
    moving = speed[speed > np.percentile(speed, MOVING)]
    slow = speed < STALLED * float(moving.mean()) if len(moving) else np.ones(len(speed), bool)
    elsewhere = np.percentile(stretched[~off], ELSEWHERE)
    found = off & slow & (stretched > STRETCHED * elsewhere)
    reach = motion.rows_in(AROUND)
    # stretches shorter than that are no contact but a moment of stick and slip
    long = np.convolve(found, np.ones(reach), "same") >= 0.5 * reach
    wide: Bools = np.convolve(found & long, np.ones(2 * reach + 1), "same") > 0
    return wide


def stretches(t: Array, rows: Bools) -> list[list[float]]:
    """Return first and last time of each run of rows [s]."""
    return [[float(t[a]), float(t[b - 1])] for a, b in runs(rows)]


def pushing(current: Array, rows: Bools) -> Bools:
    """Return which rows (T,) in contact the motor pushes in: its current is the witness.

    ``current`` (T,) is the size of the motor's current [any unit]; NaN where it was not logged.
    """
    if np.isnan(current).all() or not rows.any() or rows.all():
        return rows
    usual = float(np.nanmedian(current[~rows]))
    out = np.zeros_like(rows)
    for a, b in runs(rows):
        out[a:b] = not np.nanmedian(current[a:b]) <= usual
    return out
