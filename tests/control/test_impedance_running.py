"""Impedance control while it runs: filters, changes, bits, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control import rotation
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings
from stiction_envs.errors import StictionError
from stiction_envs.robots import load_arm
from tests.control.rig import Look, Rig, angle_between, batch, from_rotation_vector, poses

# ---- filters and changes while running -------------------------------------------------------


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
    """Only the arms named change, per arm or per axis; damping follows at once."""
    control, _ = batch(8)
    before, damping = control.stiffness, control.damping
    control.set_stiffness([2, 5], translational=[100.0, 500.0], nullspace=[[1.0] * 7, [2.0] * 7])
    after = control.stiffness
    others = [0, 1, 3, 4, 6, 7]
    np.testing.assert_array_equal(after[others], before[others])
    np.testing.assert_array_equal(control.damping[others], damping[others])
    np.testing.assert_array_equal(np.diagonal(after[2]), [100] * 3 + [20] * 3)
    np.testing.assert_array_equal(np.diagonal(after[5]), [500] * 3 + [20] * 3)
    assert (control.damping[[2, 5]] != damping[[2, 5]]).any()
    control.set_stiffness([1], rotational=[[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(np.diagonal(control.stiffness[1]), [200] * 3 + [1, 2, 3])
    kept = control.stiffness
    with pytest.raises(StictionError, match="rotational stiffness is -1"):
        control.set_stiffness([0, 1], translational=7.0, rotational=-1.0)
    np.testing.assert_array_equal(control.stiffness, kept)


# ---- bits ------------------------------------------------------------------------------------


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


def run(ids: np.ndarray, settings: dict[str, object], strided: bool = False) -> np.ndarray:
    """40 cycles of the arms ``ids`` of a common list, in one batch, (40, len(ids), 7)."""
    control, _ = batch(64, **settings)
    limits = load_arm("panda").limits
    own = CartesianImpedance(ImpedanceSettings(**settings), len(ids), limits)  # type: ignore[arg-type]
    look = Look(*(part[ids] for part in poses()))
    rng = np.random.default_rng(5)
    dither = rng.normal(size=(40, 64, 7))[:, ids]
    own.reset(None, look.position, look.quaternion, look.q + 0.1)
    x_d, o_d = control._position_target[ids], control._quaternion_target[ids]
    out = []
    for k in range(40):
        if k % 10 == 0:
            for half in (np.arange(0, len(ids), 2), np.arange(1, len(ids), 2)):
                own.update_model(half, look.jacobian[half], look.mass[half])
        if k == 10:
            own.set_reference(x_d, o_d)
        if k == 20:
            own.set_stiffness(None, translational=10.0 * (1 + ids))
        args = [part + 1e-3 * k for part in look[:5]]
        if strided:
            args = [np.repeat(a, 2, axis=0)[::2] for a in args]
            args[2] = np.asfortranarray(args[2])
        out.append(own.torque(*args, dither=dither[k]))
    return np.array(out)


# ---- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"translational_stiffness": -1.0}, "translational stiffness is -1.0.*>= 0"),
        ({"rotational_stiffness": [1.0, 2.0]}, "rotational stiffness has shape"),
        ({"translational_stiffness": "stiff"}, "translational stiffness is 'stiff'"),
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


def test_defaults_are_the_tomls_and_the_thesiss():
    """Thesis 4.1 and sources.md 6.1: 200/20/0, critical, 1 N·m per cycle at 1 kHz, filters off."""
    s = ImpedanceSettings()
    np.testing.assert_array_equal(s.translational_stiffness, [200.0] * 3)
    np.testing.assert_array_equal(s.rotational_stiffness, [20.0] * 3)
    assert s.nullspace_stiffness == 0.0
    np.testing.assert_array_equal(s.damping_ratio, [1.0] * 6)
    assert (s.torque_rate, s.rate_hz) == (1.0, 1000.0)
    assert s.filter_step == 1.0
    # controllers share them
    with pytest.raises(ValueError, match="read-only"):
        s.damping_ratio[0] = 0.5


def test_calls_that_cannot_work_are_refused():
    """No model yet, wrong sizes, dynamics that are not finite."""
    limits, look = load_arm("panda").limits, poses()
    with pytest.raises(StictionError, match="number of simulations 0"):
        CartesianImpedance(ImpedanceSettings(), 0, limits)
    with pytest.raises(StictionError, match="nullspace stiffness has shape"):
        CartesianImpedance(ImpedanceSettings(nullspace_stiffness=[1.0, 2.0]), 4, limits)
    control = CartesianImpedance(ImpedanceSettings(), 64, limits)
    control.update_model(np.arange(5), look.jacobian[:5], look.mass[:5])
    with pytest.raises(StictionError, match="simulation 5"):
        control.torque(*look[:5])
    control.update_model(None, look.jacobian, look.mass)
    with pytest.raises(StictionError, match="shape"):
        control.set_stiffness([0, 1], translational=[1.0, 2.0, 3.0])
    with pytest.raises(StictionError, match=r"expected \(4, 6, 7\)"):
        control.update_model(np.arange(4), look.jacobian, look.mass)
    with pytest.raises(ValueError, match="broadcast"):
        control.torque(*look[:5], dither=np.zeros((63, 7)))
    bad = look.mass.copy()
    bad[7, 0, 0] = np.nan
    with pytest.raises(StictionError, match="row 7"):
        control.update_model(None, look.jacobian, bad)
    bad[7] = 0.0
    with pytest.raises(StictionError, match=r"row 7.*singular"):
        control.update_model(None, look.jacobian, bad)
