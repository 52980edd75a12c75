"""Simulated servo logs: closed forms of one servo, and the plant as another engine."""

import numpy as np
import pytest

from benchmarks.servo.blind_servo_logs import robot_file
from stiction_envs.gap.servo.servo_diagnosis import diagnose_servo
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.whole_arm import simulate_arm
from stiction_envs.hidden.servo_effects import EFFECTS, ServoJoint
from stiction_envs.hidden.servo_logs import ENCODER, commands, hide
from stiction_envs.hidden.servo_simulation import simulate
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm, load_arm
from tests.gap.servo.small_arm import parameters, two_links

START = np.array([-0.6, 0.8])


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Arm:
    return two_links(tmp_path_factory.mktemp("arm"))


def told(arm: Arm, goal: float = 0.0, **values: float) -> np.ndarray:
    """Return angles (T, 2) of both joints, whose command changes after half a second."""
    p = np.stack([parameters(damping=8.0, **values)] * 2)
    p[:, INDEX["stiffness"]] = 100.0
    t = np.arange(0.0, 4.0, 0.02)
    command = np.tile(np.where(t[:, None] < 0.5, 0.0, goal), (1, 2))
    return simulate(arm, p, t, command, np.zeros(2))


def test_a_servo_sags_by_gravity_over_its_stiffness(arm: Arm) -> None:
    """Both links lie flat: 9.81 (0.15 + 0.3 · 0.6 + 0.1 · 0.6) N·m and 9.81 · 0.06 N·m."""
    sag = np.array([9.81 * 0.39, 9.81 * 0.06]) / 100.0
    np.testing.assert_allclose(told(arm)[-1], sag, rtol=0.01)
    np.testing.assert_allclose(told(arm, dead_zone=0.01)[-1], sag + 0.01, rtol=0.01)
    np.testing.assert_allclose(told(arm, compensation=0.5)[-1], sag / 2, rtol=0.01)
    np.testing.assert_allclose(told(arm, offset=0.1)[-1] - sag, 0.0, atol=1e-3)


def test_friction_holds_against_all_below_it_and_does_not_creep(arm: Arm) -> None:
    """Stiction above the arm's weight and the servo's 5 N·m: only bristles yield."""
    angle = told(arm, goal=0.05, stiction=10.0, bristle=2e-4)
    assert np.abs(angle).max() < 0.02
    assert np.abs(angle[-1] - angle[-100]).max() < 1e-6
    free = told(arm, goal=0.05)
    assert np.abs(free[-1] - told(arm)[-1] - 0.05).max() < 1e-3


def test_its_angles_are_those_of_the_plant(arm: Arm) -> None:
    """With every cause of a parameter but a bristle's, to a quarter of an encoder's step."""
    t = np.arange(0.0, 20.0, 0.02)
    command = commands(arm, t, np.random.default_rng(2), START)
    p = np.stack(
        [
            parameters(damping=1.0, stiction=0.3, drop=0.4, delay=0.03, speed_limit=0.6),
            parameters(damping=1.5, stiction=0.1, load=0.3, dead_zone=0.01, torque_limit=3.0),
        ]
    )
    p[0, INDEX["stiffness"]], p[:, INDEX["compensation"]] = 120.0, [0.4, -0.2]
    log = ServoLog(source="plan", t=t, q=command.copy(), dq=None, q_cmd=command)
    (plant,) = simulate_arm(arm, [log], p, np.ones(2), threads=1)
    own = simulate(arm, p, t, command, command[0])
    assert np.sqrt(np.mean((plant - command) ** 2, axis=0)).min() > 0.02
    assert np.sqrt(np.mean((plant - own) ** 2, axis=0)).max() < 0.25 * ENCODER


def test_a_log_has_steps_and_late_stamps_and_the_same_bits_again(arm: Arm) -> None:
    h, again = (hide(arm, ("payload",), seed=3, seconds=10.0, start=START) for _ in range(2))
    np.testing.assert_array_equal(h.log.q, again.log.q)
    np.testing.assert_allclose(h.log.q / ENCODER, np.round(h.log.q / ENCODER), atol=1e-9)
    assert 0 < np.abs(np.diff(h.log.t) - 0.02).max() < 2e-3
    assert h.hidden == (("payload", 0),)
    assert h.payload is not None
    bare = hide(arm, (), seed=3, seconds=10.0, start=START)
    lower = (h.log.q - bare.log.q)[:, 0].mean()  # it hangs forward of the shoulder
    torque = 9.81 * h.payload[0] * 0.3
    assert 0.3 * torque < lower * h.stiffness[0] < 2.0 * torque


@pytest.mark.slow
@pytest.mark.parametrize(
    "cause", ["damping", "armature", "presliding_hysteresis", "gravity_compensation_missing"]
)
def test_a_hidden_cause_is_found_on_its_joint(arm: Arm, cause: str) -> None:
    """Missing gravity compensation may be a rival of the named cause, a stiffer servo."""
    h = hide(arm, (cause,), seed=3, seconds=45.0, start=START)
    ((_, joint),) = h.hidden
    found = [c for c in diagnose_servo([h.log], arm, h.servo).causes if joint in c.joints]
    alike = cause == "gravity_compensation_missing"
    assert cause in {x for c in found for x in (c.name, *(c.confused_with if alike else ()))}


@pytest.mark.slow
def test_friction_that_grows_with_gravity_is_found_on_its_joint() -> None:
    arm = load_arm(robot_file("so100"))
    h = hide(arm, ("load_dependent_friction",), seed=4)
    assert h.hidden == (("load_dependent_friction", 2),)
    named = {(c.name, c.joints) for c in diagnose_servo([h.log], arm, h.servo).causes}
    assert ("load_dependent_friction", (2,)) in named


def test_a_hidden_coulomb_friction_is_said_as_that_of_motion() -> None:
    """A joint that breaks away at 1.0 N·m and slides at 0.6, and 0.5 N·m more at rest."""
    p = np.array(parameters(stiction=1.0, drop=0.4))
    p[INDEX["stiffness"]] = 100.0
    joint = ServoJoint(parameters=p, friction=1.0, gravity=1.0, torque=1.0, speed=1.0, inertia=1.0)
    assert EFFECTS["coulomb_friction"].shown(joint, 0.005) == pytest.approx(0.9)
