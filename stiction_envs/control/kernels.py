"""Compiled functions that a controller calls in every cycle.

With some tens of arms numpy would spend most of a cycle on the overhead of calls. Arms are computed
one after the other in plain arithmetic: an arm's result is the same bits in any batch. NaN passes
through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.rotation import slerp_one, write_one_error_matrix

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_TINY = np.finfo(np.float64).tiny


@compiled
def site_kinematics(
    anchor: Array,
    axis: Array,
    xpos: Array,
    xquat: Array,
    joints: Index,
    turn: Array,
    tool: Array,
    position: Array,
    quaternion: Array,
    jacobian: Array,
) -> None:
    """Write position, orientation and geometric Jacobian of a point and a frame fixed to a site.

    Args:
        anchor: (N, joints of the model, 3) a point of each joint's axis in the world [m].
        axis: (N, joints of the model, 3) its direction.
        xpos: (N, 3) of the site [m].
        xquat: (N, 4) of its body, w, x, y, z.
        joints: (n,) the joints that move it.
        turn: (4, 4) the frame in the site's body: q ⊗ q_frame as a matrix on q.
        tool: (3,) the point, from the site in the frame [m].
        position: (N, 3) of the point, written [m].
        quaternion: (N, 4), written.
        jacobian: (N, 6, n), written: translation above rotation [m/rad, 1].
    """
    for i in range(len(position)):
        for k in range(4):
            total = 0.0
            for m in range(4):
                total += turn[k, m] * xquat[i, m]
            quaternion[i, k] = total
        # R(q) p = p + 2 w (v × p) + 2 v × (v × p)
        w, a, b, c = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
        tx = 2.0 * (b * tool[2] - c * tool[1])
        ty = 2.0 * (c * tool[0] - a * tool[2])
        tz = 2.0 * (a * tool[1] - b * tool[0])
        x = xpos[i, 0] + (tool[0] + w * tx + (b * tz - c * ty))
        y = xpos[i, 1] + (tool[1] + w * ty + (c * tx - a * tz))
        z = xpos[i, 2] + (tool[2] + w * tz + (a * ty - b * tx))
        position[i, 0], position[i, 1], position[i, 2] = x, y, z
        for j in range(len(joints)):
            u, p = axis[i, joints[j]], anchor[i, joints[j]]
            dx, dy, dz = x - p[0], y - p[1], z - p[2]
            jacobian[i, 0, j] = u[1] * dz - u[2] * dy
            jacobian[i, 1, j] = u[2] * dx - u[0] * dz
            jacobian[i, 2, j] = u[0] * dy - u[1] * dx
            jacobian[i, 3, j], jacobian[i, 4, j], jacobian[i, 5, j] = u[0], u[1], u[2]


@compiled
def chain_kinematics(
    q: Array,
    shift: Array,
    turn: Array,
    joint_shift: Array,
    joint_axis: Array,
    zero: Array,
    anchor: Array,
    axis: Array,
    xpos: Array,
    xquat: Array,
) -> None:
    """Write what `site_kinematics` needs of serial arms at angles q, as MuJoCo computes it.

    Args:
        q: (N, n) [rad].
        shift: (n + 1, 3) from the body of the joint before to that of each joint, and to the site
            [m].
        turn: (n + 1, 4) the same turns, w, x, y, z.
        joint_shift: (n, 3) of each joint in its body [m].
        joint_axis: (n, 3) there.
        zero: (n,) angles at which bodies are as `turn` has them [rad].
        anchor: (N, n, 3), written [m].
        axis: (N, n, 3), written.
        xpos: (N, 3) of the site, written [m].
        xquat: (N, 4) of its body, written.
    """
    place, spin, moved = np.empty(3), np.empty(4), np.empty(3)
    own, turned = np.empty(4), np.empty(4)
    for i in range(q.shape[0]):
        for k in range(3):
            place[k] = 0.0
        spin[0], spin[1], spin[2], spin[3] = 1.0, 0.0, 0.0, 0.0
        for j in range(q.shape[1] + 1):
            _rotate(spin, shift[j], moved)
            for k in range(3):
                place[k] += moved[k]
            _multiply(spin, turn[j], turned)
            for k in range(4):
                spin[k] = turned[k]
            if j == q.shape[1]:
                break
            _rotate(spin, joint_shift[j], moved)
            for k in range(3):
                anchor[i, j, k] = place[k] + moved[k]
            _rotate(spin, joint_axis[j], moved)
            for k in range(3):
                axis[i, j, k] = moved[k]
            half = 0.5 * (q[i, j] - zero[j])
            own[0] = np.cos(half)
            for k in range(3):
                own[1 + k] = np.sin(half) * joint_axis[j, k]
            _multiply(spin, own, turned)
            for k in range(4):
                spin[k] = turned[k]
            _rotate(spin, joint_shift[j], moved)
            for k in range(3):
                place[k] = anchor[i, j, k] - moved[k]
        for k in range(3):
            xpos[i, k] = place[k]
        for k in range(4):
            xquat[i, k] = spin[k]


@compiled
def _rotate(q: Array, v: Array, out: Array) -> None:
    """Write v (3,) turned by a quaternion: v + 2 w (u × v) + 2 u × (u × v)."""
    w, a, b, c = q[0], q[1], q[2], q[3]
    x, y, z = 2.0 * (b * v[2] - c * v[1]), 2.0 * (c * v[0] - a * v[2]), 2.0 * (a * v[1] - b * v[0])
    out[0] = v[0] + w * x + (b * z - c * y)
    out[1] = v[1] + w * y + (c * x - a * z)
    out[2] = v[2] + w * z + (a * y - b * x)


@compiled
def _multiply(p: Array, q: Array, out: Array) -> None:
    """Write the product of quaternions p ⊗ q."""
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


@compiled
def impedance_cycle(
    position: Array,
    quaternion: Array,
    jacobian: Array,
    q: Array,
    dq: Array,
    dither: Array,
    dither_after: bool,
    rate: float,
    limit: Array,
    reference: Array,
    error_matrix: Array,
    gain: Array,
    null_active: bool,
    null_q: Array,
    null_stiffness: Array,
    null_damping: Array,
    projector: Array,
    state: Array,
    seen: Array,
    wanted: Array,
    sent: Array,
    command: Array,
) -> None:
    """Write the commands (N, n) of a `CartesianImpedance`, behind its filters.

    Args:
        position: (N, 3) measured [m].
        quaternion: (N, 4) measured.
        jacobian: (N, 6, n).
        q: (N, n) [rad].
        dq: (N, n) [rad/s].
        dither: (N, n) added to the torque [N·m].
        dither_after: whether dither is added behind the saturation.
        rate: largest change of the torque per cycle [N·m].
        limit: (n,) [N·m].
        reference: (N, 3) [m].
        error_matrix: (N, 4, 4) of `rotation.error_matrix`.
        gain: (N, 6, 12) wrench per state.
        null_active: whether the next four are used.
        null_q: (N, n) q_d [rad].
        null_stiffness: (N, n) k_n [N·m/rad].
        null_damping: (N, n) d_n [N·m·s/rad].
        projector: (N, n, n) P.
        state: (N, 12), written: error [m, rad], then J q̇ [m/s, rad/s].
        seen: (N, n), written: the angles [rad].
        wanted: (N, n), written: torque before the saturation [N·m].
        sent: (N, n), the last torque behind it, written [N·m].
        command: (N, n), written [N·m].
    """
    n = dq.shape[1]
    wrench, joint = np.empty(6), np.empty(n)
    for i in range(len(position)):
        pose_error(position[i], quaternion[i], reference[i], error_matrix[i], state[i])
        for k in range(6):
            speed = 0.0
            for j in range(n):
                speed += jacobian[i, k, j] * dq[i, j]
            state[i, 6 + k] = speed
        for k in range(6):
            total = 0.0
            for m in range(12):
                total += gain[i, k, m] * state[i, m]
            wrench[k] = total
        for j in range(n):
            seen[i, j] = q[i, j]
            wanted[i, j] = 0.0
        for k in range(6):  # joints side by side in memory
            for j in range(n):
                wanted[i, j] += jacobian[i, k, j] * wrench[k]
        if null_active:  # P (k_n (q_d − q) − d_n q̇)
            for j in range(n):
                spring = null_stiffness[i, j] * (null_q[i, j] - q[i, j])
                joint[j] = spring - null_damping[i, j] * dq[i, j]
            for j in range(n):
                total = 0.0
                for m in range(n):
                    total += projector[i, j, m] * joint[m]
                wanted[i, j] += total
        for j in range(n):
            if not dither_after:
                wanted[i, j] += dither[i, j]
            low, high = max(sent[i, j] - rate, -limit[j]), min(sent[i, j] + rate, limit[j])
            sent[i, j] = command[i, j] = _between(wanted[i, j], low, high)
            if dither_after:
                command[i, j] = _between(sent[i, j] + dither[i, j], -limit[j], limit[j])


@compiled
def pose_error(
    position: Array, quaternion: Array, reference: Array, error_matrix: Array, error: Array
) -> None:
    """Write the error of one arm into the first six of ``error`` [m, rad].

    Arguments are rows of those of `impedance_cycle`.
    """
    for k in range(3):
        error[k] = position[k] - reference[k]
    w = x = y = z = 0.0  # an array would be allocated for every arm
    for m in range(4):
        w += error_matrix[0, m] * quaternion[m]
        x += error_matrix[1, m] * quaternion[m]
        y += error_matrix[2, m] * quaternion[m]
        z += error_matrix[3, m] * quaternion[m]
    # as rotation.rotation_vector
    length = np.sqrt(x**2 + y**2 + z**2)
    factor = np.copysign(2.0 * np.arctan2(length, abs(w)) / max(length, _TINY), w)
    error[3], error[4], error[5] = factor * x, factor * y, factor * z


@compiled
def advance_reference(
    step: float,
    position_target: Array,
    quaternion_target: Array,
    position: Array,
    quaternion: Array,
    error_matrix: Array,
) -> None:
    """Move references (N, 3) [m] and (N, 4) one cycle towards their targets, and write
    `rotation.error_matrix` (N, 4, 4) of them.

    ``step`` is the share of the way [-]; at 1 they are the targets, to the bit.
    """
    for i in range(len(position)):
        if step < 1.0:
            for k in range(3):
                position[i, k] += step * (position_target[i, k] - position[i, k])
            slerp_one(quaternion[i], quaternion_target[i], step, quaternion[i])
        else:
            for k in range(3):
                position[i, k] = position_target[i, k]
            for k in range(4):
                quaternion[i, k] = quaternion_target[i, k]
        write_one_error_matrix(quaternion[i], error_matrix[i])


@compiled
def pass_torque(
    command: Array,
    step: Array,
    gain: float,
    limit: Array,
    limited: Array,
    filtered: Array,
    out: Array,
) -> None:
    """Write (N, n) torque behind rate limit, low-pass and torque limit [N·m].

    Args:
        command: (N, n) [N·m].
        step: (N, n) largest change per control step [N·m].
        gain: of the low-pass, 1 is off [-].
        limit: (N, n) [N·m].
        limited: (N, n) state behind the rate limit, changed [N·m].
        filtered: (N, n) state behind the low-pass, changed [N·m].
        out: (N, n), written [N·m].
    """
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            u = command[i, j]
            # exactly the command wherever the rate allows it
            if not abs(u - limited[i, j]) <= 0.999 * step[i, j]:
                u = _between(u, limited[i, j] - step[i, j], limited[i, j] + step[i, j])
            limited[i, j] = u
            # added up as by scipy.signal.lfilter, bit for bit
            y = filtered[i, j] * (1.0 - gain) + u * gain if gain < 1.0 else u
            filtered[i, j] = y
            out[i, j] = _between(y, -limit[i, j], limit[i, j])


@compiled
def pass_torques(
    command: Array,
    step: Array,
    gain: float,
    limit: Array,
    limited: Array,
    filtered: Array,
    out: Array,
) -> None:
    """`pass_torque` of K control steps: command and ``out`` are (N, K, n) [N·m]."""
    for k in range(command.shape[1]):
        pass_torque(command[:, k], step, gain, limit, limited, filtered, out[:, k])


@compiled
def _between(x: float, low: float, high: float) -> float:
    """Return x within low and high; NaN stays NaN."""
    if x < low:
        return low
    if x > high:
        return high
    return x
