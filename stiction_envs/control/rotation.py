"""Unit quaternions (w, x, y, z), MuJoCo's order, for N rotations at once.

Every function takes arrays with any leading shape and works element by element: a rotation's
result is the same bits in any batch. q and −q are the same rotation; where a result
could be either, the docstring says which. Formulas: Diebel, *Representing attitude*, 2006.
"""

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled

# a ⊗ b = B(b) a with the entries of b in this order and with these signs
_RIGHT = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_RIGHT_SIGN = np.array(
    [[1.0, -1.0, -1.0, -1.0], [1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0]]
)
_ERROR_SIGN = _RIGHT_SIGN * np.array([1.0, -1.0, -1.0, -1.0])[_RIGHT]
_TINY = np.finfo(float).tiny


def right_matrix(b: Array) -> Array:
    """Return matrices B (..., 4, 4) with B a = a ⊗ b."""
    return np.take(b, _RIGHT, axis=-1) * _RIGHT_SIGN


def multiply(a: Array, b: Array) -> Array:
    """Return the product a ⊗ b (..., 4): rotation b, then a, both about axes of the base frame."""
    return np.einsum("...ij,...j->...i", right_matrix(b), a)


def error_matrix(reference: Array) -> Array:
    """Return matrices E (..., 4, 4) with E q = q ⊗ q_d⁻¹, for references q_d (..., 4)."""
    return np.take(reference, _RIGHT, axis=-1) * _ERROR_SIGN


@compiled
def write_one_error_matrix(reference: Array, out: Array) -> None:
    """Write `error_matrix` (4, 4) of one reference (4,)."""
    w, x, y, z = reference[0], reference[1], reference[2], reference[3]
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = w, x, y, z
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = -x, w, -z, y
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = -y, z, w, -x
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = -z, -y, x, w


def rotation_error(q: Array, reference: Array) -> Array:
    """Return angle · axis of q ⊗ q_d⁻¹ in the base frame [rad], (..., 3); sources.md 6.1.

    The angle is in [0, π]; q (..., 4) may have any norm, and −q gives the same.
    With angular velocity ω and q_d (..., 4) at rest, d/dt ½|e|² = e·ω: the torque −k e is the
    gradient of the potential ½ k angle². With different stiffness about different axes it has none.
    """
    turn = np.einsum("...ij,...j->...i", error_matrix(reference), q)
    w, vector = turn[..., 0], turn[..., 1:]
    length = np.sqrt(np.einsum("...i,...i->...", vector, vector))
    # 0 where there is no rotation
    factor = 2.0 * np.arctan2(length, np.abs(w)) / np.maximum(length, _TINY)
    return vector * np.copysign(factor, w)[..., None]


@compiled
def angle_one(a: Array, b: Array) -> float:
    """Return the angle of the rotation from b to a (4,) [rad], in [0, π]."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[1] * b[0] - a[0] * b[1] - a[2] * b[3] + a[3] * b[2]
    y = a[2] * b[0] - a[0] * b[2] - a[3] * b[1] + a[1] * b[3]
    z = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1]
    return 2.0 * np.arctan2(np.sqrt(x * x + y * y + z * z), abs(w))


@compiled
def slerp_one(p: Array, q: Array, s: float, out: Array) -> None:
    """Write the quaternion (4,) at a share ``s`` of the shorter arc from p to q (4,).

    Exactly p at 0, and exactly q, or −q where that is nearer to p, at 1.
    """
    side = -1.0 if p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < 0.0 else 1.0
    difference, total = 0.0, 0.0
    for k in range(4):
        difference += (p[k] - side * q[k]) ** 2
        total += (p[k] + side * q[k]) ** 2
    arc = 2.0 * np.arctan2(np.sqrt(difference), np.sqrt(total))  # in [0, π/2]
    # sinc instead of sin: the weights tend to 1 − s and s where the arc vanishes
    near = (1.0 - s) * (_sinc((1.0 - s) * arc) / _sinc(arc))
    far = s * (_sinc(s * arc) / _sinc(arc))
    for k in range(4):
        out[k] = near * p[k] + far * (side * q[k])


@compiled
def _sinc(x: float) -> float:
    """Return sin(x)/x."""
    return 1.0 if x == 0.0 else np.sin(x) / x


def from_rpy(rpy: ArrayLike) -> Array:
    """Return quaternions (..., 4) of roll, pitch, yaw (..., 3) [rad] as in ROS.

    Turned about the fixed x, then y, then z axis: R = R_z(yaw) R_y(pitch) R_x(roll).
    """
    half = 0.5 * np.asarray(rpy, dtype=float)
    cr, cp, cy = np.moveaxis(np.cos(half), -1, 0)
    sr, sp, sy = np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def to_rpy(q: Array) -> Array:
    """Return roll, pitch, yaw (..., 3) [rad] of unit quaternions (..., 4); pitch in [−π/2, π/2].

    At pitch ±π/2 only a combination of roll and yaw is defined; the result is one of them. Half
    sum and half difference of roll and yaw (Bernardes and Viollet 2022) stay exact there.
    """
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    a, b, c, d = w - y, x + z, w + y, z - x
    half_sum, half_difference = np.arctan2(b, a), np.arctan2(d, c)
    out = np.empty((*q.shape[:-1], 3))
    out[..., 0], out[..., 2] = half_sum - half_difference, half_sum + half_difference
    out[..., 1] = 2.0 * np.arctan2(np.hypot(c, d), np.hypot(a, b)) - 0.5 * np.pi
    out[..., ::2] -= 2.0 * np.pi * np.rint(out[..., ::2] / (2.0 * np.pi))
    return out
