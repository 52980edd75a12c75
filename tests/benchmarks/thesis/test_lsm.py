"""The thesis's identification on simulated logs whose friction is known, and its failure."""

import numpy as np
import pytest

from benchmarks.accuracy import imperfect_arms as excited
from benchmarks.thesis import lsm
from benchmarks.thesis.lsm import lines_of
from benchmarks.thesis.rosdyn import rosdyn
from stiction_envs.identification.identify import identify
from stiction_envs.measured.thesis_tables import thesis_table
from stiction_envs.robots import load_arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import consistent, inertial_parameters
from tests.refusal import refusal


@pytest.fixture(scope="module")
def clean() -> lsm.LineFit:
    return lsm.fit_lines("panda", "nothing")


def intercepts(fit: lsm.LineFit) -> np.ndarray:
    return np.array([x.intercept for x in fit.lines.values()]).reshape(7, 2)


def test_a_clean_log_gives_bands_without_their_stribeck_peak(clean):
    share = np.abs(intercepts(clean)) / lsm.bands_of("panda")[:, None]
    assert np.all(np.sign(intercepts(clean)) == [1, -1])
    assert np.all((share > lsm.COULOMB_RATIO) & (share < 1))
    assert clean.links is None


def test_an_error_of_gravity_moves_intercepts_and_noise_does_not(clean):
    heavy, noisy = (lsm.fit_lines("panda", w) for w in ("gravity error", "noisy acceleration"))
    middle = np.abs(intercepts(heavy).sum(axis=1)) / 2
    assert middle.max() > 1.0
    assert np.abs(intercepts(clean).sum(axis=1)).max() < 0.05
    assert np.abs(intercepts(noisy) - intercepts(clean)).max() < 0.2
    r2 = [np.median([x.r2 for x in fit.lines.values()]) for fit in (clean, noisy)]
    assert r2[1] < 0.1 * r2[0]


def test_lines_are_those_of_known_data():
    speed = np.linspace(-1, 1, 401)[:, None]
    torque = np.where(speed > 0, 0.5 + 0.2 * speed, -0.3 + 0.1 * speed)
    plus, minus = (lines_of(speed, torque)[1, d] for d in "+-")
    assert (plus.intercept, plus.slope) == (pytest.approx(0.5), pytest.approx(0.2))
    assert (minus.intercept, minus.slope) == (pytest.approx(-0.3), pytest.approx(0.1))
    assert plus.r2 == pytest.approx(1.0)


def test_unconstrained_links_have_negative_masses_where_joints_rest():
    """Table 4.1: links 3 to 7 off by hundreds of kg, in this proportion, if joints 1, 2 rest."""
    arm = load_arm("iiwa7")
    reach = np.array([0, 0, 0.5, 0.5, 0.5, 0.5, 0.5])
    state = excited.from_pose_to_pose(arm, reach, 60.0, 200.0, 0)
    log = excited.log(excited.perturbed(arm, 0.1, 0), state, 200.0, noise=0.1, seed=0)
    theirs = rosdyn([log], arm)
    assert len(theirs.negative_masses) > 0
    assert len(theirs.impossible) == 7
    assert np.abs(theirs.phi[:, 0]).max() > 100
    nominal = inertial_parameters(arm.pinocchio())[:, 0]
    masses = {r["joint"]: r["value"] for r in thesis_table("4.1") if r["quantity"] == "mass"}
    printed = np.array([masses[j] for j in range(1, 8)])
    ours, printed = (theirs.phi[:, 0] - nominal)[2:], (printed - nominal)[2:]
    alike = ours @ printed / np.linalg.norm(ours) / np.linalg.norm(printed)
    assert abs(alike) > 0.998  # links 4 to 7 alike and nothing else would be 0.992
    found = identify([log], arm, torque="link")
    assert consistent(found.phi).all()
    assert found.gain_percent > 20
    refusal(lambda: with_inertias(arm, theirs.phi), "physically inconsistent")


@pytest.mark.slow
def test_a_joint_at_constant_speed_has_the_friction_of_the_law():
    curve = lsm.friction_curve("panda", threads=1)
    np.testing.assert_allclose(curve.torque, curve.law(curve.speed), rtol=0.02)
    np.testing.assert_allclose(curve.torque, -curve.torque[::-1], rtol=1e-3)
    # the Stribeck effect is there: less at ten Stribeck velocities than at a third of one
    slow = np.abs(curve.torque[np.abs(curve.speed) < curve.stribeck[0] / 2]).min()
    fast = np.abs(curve.torque[np.isclose(np.abs(curve.speed), 0.0275, rtol=0.1)]).max()
    assert fast < 0.9 * slow
