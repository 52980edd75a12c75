"""Quaternion helpers against scipy, their limit cases, and bits that do not depend on the batch."""

import numpy as np
from scipy.spatial.transform import Rotation

from stiction_envs.control import rotation
from tests.control.rig import angle_between, from_rotation_vector


def random(n: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


def scipy(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def same(a: np.ndarray, b: np.ndarray) -> None:
    """Assert that rotations are the same; the sign of a quaternion does not count."""
    np.testing.assert_allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, atol=1e-14)


def test_product_is_scipys():
    """a ⊗ b turns by b, then a; w first."""
    a, b = random(200), random(200, 1)
    same(rotation.multiply(a, b), (scipy(a) * scipy(b)).as_quat(scalar_first=True))
    np.testing.assert_array_equal(rotation.multiply(a[0], np.array([1.0, 0.0, 0.0, 0.0])), a[0])


def test_rotation_error_is_angle_times_axis_in_the_base_frame():
    """sources.md 6.1: e = angle·axis of q·q_d⁻¹; turning q_d by e gives q."""
    q, d = random(200), random(200, 1)
    e = rotation.rotation_error(q, d)
    np.testing.assert_allclose(e, (scipy(q) * scipy(d).inv()).as_rotvec(), atol=1e-13)
    same(rotation.multiply(from_rotation_vector(e), d), q)
    np.testing.assert_allclose(rotation.rotation_error(q[3], d[3]), e[3], atol=1e-15)


def test_roll_pitch_yaw_are_ros_fixed_axes():
    """R = R_z(yaw) R_y(pitch) R_x(roll); pitch ±π/2 still gives the same rotation."""
    rpy = np.random.default_rng(0).uniform(-1.5, 1.5, (100, 3))
    q = rotation.from_rpy(rpy)
    same(q, Rotation.from_euler("xyz", rpy).as_quat(scalar_first=True))
    np.testing.assert_allclose(rotation.to_rpy(q), rpy, atol=1e-13)
    locked = rotation.from_rpy([0.3, np.pi / 2, -0.4])
    assert angle_between(rotation.from_rpy(rotation.to_rpy(locked)), locked) < 1e-7


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
