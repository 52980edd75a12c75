"""Impedance control while it runs: filters, changes, bits, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control import rotation
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings, renew_space
from stiction_envs.errors import StictionError
from stiction_envs.robots import load_arm
from tests.control.rig import Rig, angle_between, batch, from_rotation_vector


@pytest.mark.parametrize("p", [0.1, 0.5, 0.95])
def test_the_filter_reaches_its_fraction_after_one_second(p):
    """x ← x + s(target − x), s = 1/(κf + 1), κ = −1/ln(1 − p): p after one second."""
    rig = Rig(pose_filter=p)
    pose, control = rig.look(), rig.control
    turn = from_rotation_vector([0.0, 0.0, 1.0])
    control.set_reference(pose.position + 1.0, rotation.multiply(turn, pose.quaternion))
    still = np.zeros((1, 7))
    for _ in range(1000):
        control.torque(*pose[:4], still)
    reached = 1 - (1 - control.settings.filter_step) ** 1000
    assert reached == pytest.approx(p, abs=2e-3)
    position, quaternion = control.reference
    np.testing.assert_allclose(position - pose.position, reached, atol=1e-9)
    angle = angle_between(quaternion, pose.quaternion)
    np.testing.assert_allclose(angle, reached, atol=1e-9)


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
        ({"translational_stiffness": -1.0}, "translational stiffness is -1.0.*>= 0"),
        ({"rotational_stiffness": [1.0, 2.0]}, "rotational stiffness has shape"),
        (
            {"translational_stiffness": "stiff"},
            "translational stiffness is a str",
        ),
        ({"nullspace_stiffness": np.nan}, "nullspace stiffness is nan"),
        ({"damping_ratio": 1.1}, "damping ratio is 1.1.*<= 1"),
        ({"torque_rate": 0.0}, "torque rate is 0.0.*> 0"),
        ({"pose_filter": 0.0}, "pose filter is 0.0.*> 0 and <= 1"),
        ({"rate_hz": np.inf}, "rate hz is inf.*finite"),
        ({"limit_margin": [1.0, 2.0]}, "limit margin has shape"),
    ],
)
def test_bad_settings_say_what_and_what_was_expected(change, words):
    with pytest.raises(StictionError, match=words):
        ImpedanceSettings(**change)


def test_controllers_that_cannot_be_made_are_refused():
    limits = load_arm("panda").limits
    with pytest.raises(StictionError, match="number of simulations 0"):
        CartesianImpedance(ImpedanceSettings(), 0, limits)
    with pytest.raises(StictionError, match="nullspace stiffness has shape"):
        CartesianImpedance(ImpedanceSettings(nullspace_stiffness=[1.0, 2.0]), 4, limits)


def test_a_pose_without_operational_space_leaves_the_last():
    """An inertia that is singular or not finite: nothing is written."""
    control, look = batch(2)
    before = control.arrays.projector.copy()
    for bad in (np.full((7, 7), np.nan), np.zeros((7, 7))):
        assert not renew_space(1, look.jacobian[1], bad, control.arrays)
    np.testing.assert_array_equal(control.arrays.projector, before)
