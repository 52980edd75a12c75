"""Quaternion helpers against scipy, their limit cases, and bits that do not depend on the batch."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stiction_envs.control import rotation
from tests.control.rig import angle_between, from_rotation_vector


def random(n: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


def scipy(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def same(a: np.ndarray, b: np.ndarray) -> None:
    """Same rotations, whatever the sign of the quaternions."""
    np.testing.assert_allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, atol=1e-14)


def test_product_and_matrix_are_scipys():
    """a ⊗ b turns by b, then a; w first."""
    a, b = random(200), random(200, 1)
    np.testing.assert_allclose(
        rotation.to_matrix(rotation.multiply(a, b)), (scipy(a) * scipy(b)).as_matrix(), atol=1e-14
    )
    np.testing.assert_array_equal(rotation.multiply(a[0], np.array([1.0, 0.0, 0.0, 0.0])), a[0])


def test_rotation_error_is_angle_times_axis_in_the_base_frame():
    """sources.md 6.1: e = angle·axis of q·q_d⁻¹; turning q_d by e gives q."""
    q, d = random(200), random(200, 1)
    e = rotation.rotation_error(q, d)
    np.testing.assert_allclose(e, (scipy(q) * scipy(d).inv()).as_rotvec(), atol=1e-13)
    same(rotation.multiply(from_rotation_vector(e), d), q)
    np.testing.assert_allclose(rotation.rotation_error(q[3], d[3]), e[3], atol=1e-15)


def test_rotation_error_is_the_same_for_q_and_minus_q():
    """Double cover: the sign is flipped where q·q_d < 0, bit for bit."""
    q, d = random(200), random(200, 1)
    e = rotation.rotation_error(q, d)
    for a, b in ((-q, d), (q, -d), (-q, -d)):
        np.testing.assert_array_equal(rotation.rotation_error(a, b), e)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-9, 1e-4, 1.0, 3.1, np.pi])
def test_exponential_and_logarithm_are_inverse(angle):
    """log(exp(v)) = v, also where sin(v/2)/v tends to a half and at half a turn."""
    axis = np.array([[1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.48, 0.6, 0.64]])
    v = angle * axis
    q = from_rotation_vector(v)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    back = rotation.rotation_vector(q)
    assert np.isfinite(back).all()
    np.testing.assert_allclose(back, v, rtol=1e-14, atol=1e-155)


def test_error_is_a_gradient():
    """d/dt ½|e|² = e·ω for q̇ = ½ ω ⊗ q: finite differences."""
    q, d = random(50), random(50, 1)
    omega = np.random.default_rng(2).normal(size=(50, 3))
    h = 1e-6
    energy = [
        0.5 * np.sum(rotation.rotation_error(rotation.multiply(turn, q), d) ** 2, axis=1)
        for turn in (
            from_rotation_vector(h * omega),
            from_rotation_vector(-h * omega),
        )
    ]
    slope = (energy[0] - energy[1]) / (2 * h)
    e = rotation.rotation_error(q, d)
    np.testing.assert_allclose(slope, np.sum(e * omega, axis=1), atol=1e-8)


def test_roll_pitch_yaw_are_ros_fixed_axes():
    """R = R_z(yaw) R_y(pitch) R_x(roll); pitch ±π/2 still gives the same rotation."""
    rpy = np.random.default_rng(0).uniform(-1.5, 1.5, (100, 3))
    q = rotation.from_rpy(rpy)
    same(q, Rotation.from_euler("xyz", rpy).as_quat(scalar_first=True))
    np.testing.assert_allclose(rotation.to_rpy(q), rpy, atol=1e-13)
    locked = rotation.from_rpy([0.3, np.pi / 2, -0.4])
    assert angle_between(rotation.from_rpy(rotation.to_rpy(locked)), locked) < 1e-7


def test_compiled_twins_are_the_same():
    """Of the error matrix to the bit, of the angle to rounding; 0 between equal ones."""
    a, b = random(200), random(200, 1)
    written = np.empty((200, 4, 4))
    rotation.write_error_matrix(a, written)
    np.testing.assert_array_equal(written, rotation.error_matrix(a))
    angle = [rotation.angle_one(p, q) for p, q in zip(a, b, strict=True)]
    np.testing.assert_allclose(angle, angle_between(a, b), atol=1e-14)
    assert all(rotation.angle_one(q, q) == rotation.angle_one(q, -q) == 0 for q in a)


def test_slerp_turns_evenly_about_one_axis_on_the_shorter_arc():
    """The angle from the start is fraction · whole angle, and both ends are exact."""
    a, b = random(100), random(100, 1)
    whole = angle_between(a, b)

    def slerp(end: np.ndarray, share: float) -> np.ndarray:
        out = np.empty_like(a)
        for p, q, row in zip(a, end, out, strict=True):
            rotation.slerp_one(p, q, share, row)
        return out

    for s in (0.0, 0.25, 0.5, 1.0):
        q = slerp(b, s)
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-14)
        np.testing.assert_allclose(angle_between(a, q), s * whole, atol=1e-13)
        np.testing.assert_allclose(angle_between(q, b), (1 - s) * whole, atol=1e-13)
    np.testing.assert_array_equal(slerp(b, 0.0), a)
    flipped = np.where(np.sum(a * b, axis=1)[:, None] < 0, -b, b)
    np.testing.assert_array_equal(slerp(b, 1.0), flipped)
    for s in np.linspace(0, 1, 100):
        np.testing.assert_allclose(slerp(a, s), a, atol=1e-15)


def test_bits_do_not_depend_on_the_batch():
    """Element by element: row k alone is row k of 64, and any leading shape will do."""
    a, b = random(64), random(64, 1)
    cases = {
        "multiply": lambda i: rotation.multiply(a[i], b[i]),
        "rotation_error": lambda i: rotation.rotation_error(a[i], b[i]),
        "to_matrix": lambda i: rotation.to_matrix(a[i]),
        "rpy": lambda i: rotation.from_rpy(rotation.to_rpy(a[i])),
    }
    for name, call in cases.items():
        whole = call(slice(None))
        for part in (slice(5, 6), slice(5, 12)):
            np.testing.assert_array_equal(call(part), whole[part], err_msg=name)
    np.testing.assert_array_equal(
        rotation.multiply(a.reshape(8, 8, 4), b.reshape(8, 8, 4)).reshape(64, 4),
        rotation.multiply(a, b),
    )
