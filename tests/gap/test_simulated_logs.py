"""Causes as textbooks write them, in logs that somebody else's simulation could have made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.diagnosis import Diagnosis, NamedCause, diagnose_logs
from stiction_envs.hidden.hidden_motions import MOTIONS
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.simulated_logs import MIDDLE, believed, dahl, inverse, plain_log


def solved(cause: str | None, robot: str = "panda", **options) -> Diagnosis:
    believed_arm = believed(cause, robot)
    return diagnose_logs([plain_log(cause, robot=robot, **options)], believed_arm)


def value(named: NamedCause, joint: int, key: str) -> float:
    return float(np.ravel(named.parameters[joint][key].value)[0])


# hidden, what is named first, and one of its parameters
FIRST = [
    ("coulomb_friction", "coulomb_friction", "coulomb_nm", 1.0),
    ("viscous_friction", "viscous_friction", "viscous_nms", 1.0),
    ("stribeck_friction", "coulomb_friction", "coulomb_nm", 1.0),
    ("stribeck_alone", "stribeck_friction", "stribeck_velocity", 0.1),
    ("direction_asymmetry", "coulomb_friction", "coulomb_nm", 1.0),
    ("load_dependent_friction", "load_dependent_friction", "load_coefficient", 0.1),
    ("load_alone", "load_dependent_friction", "load_coefficient", 0.1),
    ("presliding_hysteresis", "coulomb_friction", "coulomb_nm", 1.0),
    ("position_dependent_friction", "position_dependent_friction", "periods_per_rev", 20.0),
    ("warm_up_drift", "coulomb_friction", "coulomb_nm", 1.0),
    ("torque_offset", "torque_offset", "offset_nm", 1.0),
    ("torque_scale", "torque_scale", "scale", 1.1),
    ("payload", "payload", "mass_kg", 1.0),
    ("base_tilt", "base_tilt", "tilt_rad", 0.05),
    ("link_inertia", "link_inertia", "armature_kgm2", 0.4),
    ("joint_elasticity", "joint_elasticity", "stiffness_nm_per_rad", 2000.0),
    ("actuator_delay", "actuator_delay", "delay_s", 0.01),
    ("external_spring", "external_spring", "stiffness_nm_per_rad", 3.0),
]
BESIDE = ("stribeck_friction", "presliding_hysteresis", "warm_up_drift")
"""Hidden together with dry friction, and named too."""


@pytest.mark.parametrize(("hidden", "first", "key", "truth"), FIRST, ids=lambda x: str(x))
def test_a_textbook_effect_is_named(hidden: str, first: str, key: str, truth: float) -> None:
    found = solved(hidden, rate=250.0)
    named = {c.name: c for c in found.causes}
    assert found.causes[0].name == first
    joint = 0 if 0 in named[first].parameters else 4
    assert np.isclose(value(named[first], joint, key), truth, rtol=0.2)
    if hidden in BESIDE:
        assert hidden in named
    assert found.verdict == "explained"


@pytest.mark.parametrize("distance", [0.04, pytest.param(0.06, marks=pytest.mark.slow)])
def test_joints_that_yield_far_are_named_with_their_stiffness(distance: float) -> None:
    """Dahl's friction that builds up over 40 or 60 mrad, in a log of small reversals."""
    rng = np.random.default_rng(3)
    t = np.arange(0, 20, 1 / 250)
    q = MOTIONS["reversals"](rng, t)
    v = np.gradient(q, t, axis=0)
    tau = inverse("panda", q, v, np.gradient(v, t, axis=0)) + 0.03 * rng.normal(size=q.shape)
    for j in (1, 3, 5):
        tau[:, j] += dahl(q[:, j], 1.0, 1.0 / distance)
    found = diagnose_logs([JointLog(source="yields.csv", t=t, q=q, dq=None, tau=tau)], "panda")
    named = {c.name: c for c in found.causes}
    assert set(named) == {"coulomb_friction", "presliding_hysteresis"}
    assert named["presliding_hysteresis"].joints == (2, 4, 6)
    for parameters in named["presliding_hysteresis"].parameters.values():
        low, high = parameters["bristle_stiffness"].ci95
        assert low < 1.0 / distance < high
    assert found.verdict == "explained"


@pytest.mark.parametrize(("hidden", "joint"), [("smooth_waves", 4), ("smooth_hump", 2)])
def test_a_smooth_torque_over_the_angle_is_named(hidden: str, joint: int) -> None:
    """And what is found on the joint is the curve that was hidden, at the angles of the log."""
    found = solved(hidden, joints=(joint,), rate=250.0)
    first = found.causes[0]
    assert (first.name, first.joints) == ("position_dependent_torque", (joint,))
    assert {j for c in found.causes for j in c.joints} == {joint}
    log = plain_log(hidden, joints=(joint,), rate=250.0, noise=0.0)
    rigid = plain_log(None, rate=250.0, noise=0.0)
    truth = np.interp(found.data.t, log.t, (log.tau - rigid.tau)[:, joint - 1])
    off = found.torque(joint - 1) - truth
    assert np.sqrt(np.mean(off**2)) < 0.1 * truth.std()


def test_a_wrong_link_is_named() -> None:
    found = solved("link_parameters", joints=(4,), rate=250.0)
    assert found.causes[0].name == "link_parameters"


def test_a_hand_that_is_not_there_is_a_payload_of_negative_mass() -> None:
    found = solved("phantom_payload", rate=250.0)
    assert found.causes[0].name == "payload"
    assert value(found.causes[0], 0, "mass_kg") == pytest.approx(-0.7, rel=0.1)


@pytest.mark.parametrize(
    ("robot", "noise", "rate", "seconds", "seed"),
    [
        ("panda", 0.01, 500.0, 12.0, 50),
        ("iiwa7", 0.05, 200.0, 20.0, 51),
        ("iiwa14", 0.5, 250.0, 15.0, 52),
    ],
)
def test_no_effect_is_no_discrepancy(
    robot: str, noise: float, rate: float, seconds: float, seed: int
) -> None:
    found = solved(None, robot, noise=noise, rate=rate, seconds=seconds, seed=seed)
    assert found.verdict == "no discrepancy"
    assert not found.causes


def test_friction_of_all_joints_is_named_on_all_joints() -> None:
    joints = (1, 2, 3, 4, 5, 6, 7)
    found = solved("coulomb_friction", joints=joints, size=0.4, rate=250.0, angle_noise=1e-5)
    assert [c.name for c in found.causes] == ["coulomb_friction"]
    assert found.causes[0].joints == joints


def test_a_constant_torque_about_a_vertical_axis_is_an_offset() -> None:
    """Only joint 1 turns, so that gravity never changes: neither payload nor tilt is named."""
    log = plain_log(None, robot="iiwa7", rate=200.0, seconds=10.0)
    q = np.tile(MIDDLE, (len(log.q), 1))
    q[:, 0] = log.q[:, 0]
    v = np.gradient(q, log.t, axis=0)
    tau = inverse("iiwa7", q, v, np.gradient(v, log.t, axis=0))
    tau[:, 1] += 1.0
    rng = np.random.default_rng(0)
    found = diagnose_logs([replace(log, q=q, tau=tau + 0.02 * rng.normal(size=q.shape))], "iiwa7")
    assert {c.name for c in found.causes} == {"torque_offset"}
