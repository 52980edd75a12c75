"""Cartesian impedance control: limit cases of equations 2.9 to 2.17 on frictionless arms."""

import numpy as np
import pytest

from stiction_envs.control import rotation
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings, renew_space
from stiction_envs.errors import StictionError
from stiction_envs.robots import load_arm
from tests.control.rig import Rig, batch, from_rotation_vector
from tests.refusal import refusal


def test_torque_is_the_printed_law():
    """τ = Jᵀ(−K e − D J q̇) + P(k_n(q_d − q) − d_n q̇) + dither, term by term."""
    control, look = batch(nullspace_stiffness=10.0, translational_stiffness=[200, 300, 400])
    rng = np.random.default_rng(2)
    dither = rng.normal(size=(64, 7))
    q_d = look.q + rng.normal(size=(64, 7)) * 0.1
    x_d, o_d = control.reference
    control.reset(np.arange(64), x_d, o_d, q_d)
    tau = control.torque(*look[:5], dither=dither)
    e = np.hstack([look.position - x_d, rotation.rotation_error(look.quaternion, o_d)])
    stiffness = np.diag([200, 300, 400, 20, 20, 20])
    limit = load_arm("panda").limits.torque
    for k in range(64):
        jac = look.jacobian[k]
        force = -stiffness @ e[k] - control.damping[k] @ jac @ look.dq[k]
        null = 10 * (q_d[k] - look.q[k]) - 2 * np.sqrt(10) * look.dq[k]
        expected = jac.T @ force + control.arrays.projector[k] @ null + dither[k]
        np.testing.assert_allclose(tau[k], np.clip(expected, -limit, limit), atol=1e-10)
    np.testing.assert_allclose(control.error, e, atol=1e-15)


def test_energy_never_grows_without_reference_motion():
    """Passivity: d/dt(½ q̇ᵀM q̇ + ½ eᵀK e) = −(J q̇)ᵀ D J q̇ ≤ 0, through large fast motions."""
    rig = Rig(dt=2e-4, damping_ratio=0.3)
    pose = rig.look()
    turn = from_rotation_vector([0.4, -0.5, 0.3])
    rig.control.set_reference(
        pose.position + np.array([0.1, 0.15, -0.1]), rotation.multiply(turn, pose[1])
    )
    rig.data.qvel[:] = [0.5, -0.3, 0.4, 0.2, -0.6, 0.5, 0.7]
    energy = np.empty(5000)
    for k in range(len(energy)):
        look = rig.step()
        e, dq = rig.control.error[0], look.dq[0]
        energy[k] = 0.5 * (dq @ look.mass[0] @ dq + e @ rig.control.stiffness[0] @ e)
    # the torque is held for a step: what that lets through is of the order of the step
    assert np.diff(energy).max() < 1e-5 * energy[0]
    assert energy[-1] < 0.5 * energy[0]


def test_inertia_and_a_projector_that_does_not_accelerate_the_flange():
    """Λ = (J M⁻¹ Jᵀ)⁻¹. Eq. 2.17: P² = P and J M⁻¹ P = 0; rank n − 6."""
    control, look = batch()
    good = ~control.flags[0]
    assert good.sum() > 40
    jac, found = look.jacobian[good], control.arrays.inertia[good]
    inertia = np.linalg.inv(jac @ np.linalg.solve(look.mass[good], np.swapaxes(jac, 1, 2)))
    largest = inertia.max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / largest, inertia / largest, atol=1e-9)
    p = control.arrays.projector[good]
    np.testing.assert_allclose(p @ p, p, atol=1e-9)
    flange = jac @ np.linalg.solve(look.mass[good], p)
    np.testing.assert_allclose(flange, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.trace(p, axis1=1, axis2=2), 1.0, atol=1e-9)


def test_stretched_arm_is_flagged_and_bounded():
    """At a stretched arm J loses rank: Λ ≤ 2 S²/s_0, torques within limits, no NaN on the way."""
    rig = Rig("iiwa7", nullspace_stiffness=10.0, torque_rate=1.0)
    rig.put(np.zeros(7))
    assert rig.control.flags[0][0]
    eigenvalues = np.linalg.eigvalsh(rig.control.arrays.inertia[0])
    assert 0 < eigenvalues[0] <= eigenvalues[-1] <= 2.0 / 1e-3 * (1 + 1e-9)
    pose = rig.look()
    out_of_reach = pose.position + np.array([0.0, 0.0, 0.5])
    rig.control.set_reference(out_of_reach, pose.quaternion)
    rig.data.qvel[:] = 0.3
    for _ in range(2000):
        rig.step()
        assert (np.abs(rig.data.qfrc_applied) <= rig.arm.limits.torque).all()
    assert np.isfinite(rig.data.qvel).all()
    assert np.abs(rig.data.qvel).max() < 10.0


def test_command_changes_by_one_newton_metre_per_cycle():
    """sources.md 6.1: each joint's change is clipped to δ = 1 N·m against the last command."""
    control, look = batch(torque_rate=1.0)
    previous = np.zeros((64, 7))
    still = np.zeros((64, 7))
    wanted, _ = batch()
    goal, limit = wanted.torque(*look[:4], still), load_arm("panda").limits.torque
    for _ in range(100):
        tau = control.torque(*look[:4], still)
        change = np.clip(goal - previous, -1.0, 1.0)
        np.testing.assert_allclose(tau, previous + change, atol=1e-12)
        cut = (np.abs(goal - previous) > 1.0) | (np.abs(goal) >= limit)
        np.testing.assert_array_equal(control.flags[1], cut.any(axis=1))
        previous = tau
    control.reset([3], look.position[3], look.quaternion[3], look.q[3])
    assert not control.flags[1][3]


def test_dither_counts_towards_the_saturation():
    """A dither of 5 N·m square is cut to 1 N·m per cycle, and never exceeds the limits."""
    control, look = batch(torque_rate=1.0)
    control.reset(np.arange(64), look.position, look.quaternion, look.q)
    still, dither = np.zeros((64, 7)), np.full((64, 7), 5.0)
    for factor, expected in ((1.0, 1.0), (-1.0, 0.0)):
        tau = control.torque(*look[:4], still, dither=factor * dither)
        np.testing.assert_allclose(tau, expected, atol=1e-12)
    large = control.torque(*look[:4], still, dither=1e3 * dither)
    assert (np.abs(large) <= load_arm("panda").limits.torque).all()
    assert control.flags[1].all()


def test_near_limit_flag():
    """A joint within the margin of its limit, or beyond it, is near."""
    control, look = batch(limit_margin=0.05)
    limits = load_arm("panda").limits.position
    q = np.tile(limits.mean(axis=1), (64, 1))
    q[1, 3], q[2, 5], q[3, 0] = limits[3, 0] + 0.04, limits[5, 1] + 0.5, limits[0, 1] - 0.06
    control.torque(*look[:3], q, look.dq)
    assert control.flags[2].nonzero()[0].tolist() == [1, 2]


def test_stiffness_of_single_arms():
    """Only the arms named change; damping follows at once."""
    control, _ = batch(8)
    before, damping = control.stiffness, control.damping
    control.set_stiffness(np.array([2, 5]), [[100.0], [500.0]], 20.0, [[0.0], [2.0]])
    others = [0, 1, 3, 4, 6, 7]
    np.testing.assert_array_equal(control.stiffness[others], before[others])
    np.testing.assert_array_equal(control.damping[others], damping[others])
    np.testing.assert_array_equal(np.diagonal(control.stiffness[2]), [100] * 3 + [20] * 3)
    np.testing.assert_array_equal(np.diagonal(control.stiffness[5]), [500] * 3 + [20] * 3)
    np.testing.assert_allclose(np.diagonal(control.damping[2]), [20] * 3 + [2 * np.sqrt(20)] * 3)
    assert control.arrays.null_active[[2, 5]].tolist() == [False, True]


def test_q_and_minus_q_give_the_same_torque():
    """Double cover: neither the measured nor the desired quaternion's sign matters, to the bit."""
    control, look = batch()
    x_d, o_d = control.reference
    tau = control.torque(*look[:5])
    for measured, desired in ((-1, 1), (1, -1), (-1, -1)):
        control, _ = batch()
        control.set_reference(x_d, desired * o_d)
        other = control.torque(look.position, measured * look.quaternion, *look[2:5])
        np.testing.assert_array_equal(other, tau)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"translational_stiffness": -1.0}, "translational_stiffness is -1.0: .*>= 0"),
        ({"rotational_stiffness": [1.0, 2.0]}, "rotational_stiffness is .*of length >= 3"),
        ({"translational_stiffness": "stiff"}, "translational_stiffness is 'stiff': expected"),
        ({"nullspace_stiffness": np.nan}, "nullspace_stiffness is nan"),
        ({"damping_ratio": 1.1}, "damping_ratio is 1.1.*<= 1"),
        ({"torque_rate": 0.0}, "torque_rate is 0.0.*> 0"),
        ({"singular_length": np.inf}, "singular_length is inf"),
        ({"limit_margin": [1.0, 2.0]}, "limit_margin is .*expected `float`"),
    ],
)
def test_bad_settings_say_what_and_what_was_expected(change, words):
    refusal(lambda: ImpedanceSettings(**change), words)


def test_nullspace_stiffness_of_other_joints_is_refused():
    limits = load_arm("panda").limits
    with pytest.raises(StictionError, match="nullspace stiffness has shape"):
        CartesianImpedance(ImpedanceSettings(nullspace_stiffness=[1.0, 2.0]), 4, limits)


def test_a_pose_without_operational_space_leaves_the_last():
    """An inertia that is singular or not finite: nothing is written."""
    control, look = batch(2)
    before = control.arrays.projector.copy()
    for bad in (np.full((7, 7), np.nan), np.zeros((7, 7))):
        assert not renew_space(1, look.jacobian[1], bad, control.arrays)
    np.testing.assert_array_equal(control.arrays.projector, before)
