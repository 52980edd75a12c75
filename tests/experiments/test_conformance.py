"""The stiction conformance test: what must pass, and what must fail it."""

import mujoco
import numpy as np
import pytest

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.conformance import conformance
from stiction_envs.robots import BUILTIN
from tests.friction.gyro import sticking
from tests.refusal import refusal

NO_RAMP = ()


def lugre(values: str = "2000 12 0.5 0.6 0.003", *, body: str = "", motor: str = "") -> str:
    """One hinge with a passive LuGre motor, Euler at 1 ms."""
    return f"""
<mujoco><option timestep="0.001" integrator="Euler"/><worldbody>
  <body><joint name="j" axis="0 0 1" {body}/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.08 0.08 0.08"/></body></worldbody>
  <actuator><dcmotor joint="j" input="none" motorconst="0" resistance="1" lugre="{values}" {motor}/>
  </actuator></mujoco>"""


def stock(frictionloss: float = 0.3, *, actuator: str = "") -> str:
    """One hinge with MuJoCo's own frictionloss, default solver settings."""
    return f"""
<mujoco><worldbody><body><joint name="j" axis="0 0 1" frictionloss="{frictionloss}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body></worldbody>
  <actuator>{actuator}</actuator></mujoco>"""


@pytest.mark.parametrize(
    "robot",
    [r if r == "iiwa14" else pytest.param(r, marks=pytest.mark.slow) for r in BUILTIN],
)
def test_every_joint_of_every_arm_sticks(robot):
    report = conformance(robot)
    assert report.passed, str(report)
    assert [j.name for j in report.joints] == [f"joint{i}" for i in range(1, 8)]
    for joint in report.joints:
        assert joint.still < 1e-6
        assert joint.go_time < 20
        # LuGre's deflection at slow rise; a finite rise and the ripple add a little
        assert joint.deflection == pytest.approx(joint.presliding, rel=0.15)
        slow, *_, fast = joint.breakaway
        # at the floor F_c + ripple, 1 ms samples miss the ripple's peak by up to 1e-5 N·m
        assert np.all(np.diff(joint.breakaway) <= 2e-5)
        assert fast < slow < 1.03 * joint.stiction


def test_lugre_joint_passes():
    report = conformance(lugre())
    (joint,) = report.joints
    assert report.passed
    assert joint.stiction == 0.6
    assert joint.presliding == pytest.approx(2.302585 * 0.6 / 2000)
    assert joint.deflection == pytest.approx(joint.presliding, rel=0.05)
    assert joint.still < 1e-12
    assert joint.breakaway[0] == pytest.approx(0.6, rel=0.03)
    assert 0.5 <= joint.breakaway[-1] < 0.51
    assert list(joint.breakaway) == sorted(joint.breakaway, reverse=True)


def test_gear_counts():
    """Stiction behind a gear is F_s × gear, bristle stiffness σ0 × gear²."""
    (joint,) = conformance(lugre(motor='gear="3"'), rates=NO_RAMP).joints
    assert joint.stiction == pytest.approx(1.8)
    assert joint.presliding == pytest.approx(2.302585 * 1.8 / 18_000)
    assert joint.passed
    assert joint.deflection == pytest.approx(joint.presliding, rel=0.05)


def test_elastic_joint_is_tested_on_its_motor():
    """The spring hinge carries no friction: it is not tested, and the motor hinge sticks."""
    model = sticking(joint_stiffness=[5e3, np.inf], stiction=[0.5, 0.5], rotor_inertia=0.1)
    report = conformance(model, rates=NO_RAMP)
    assert [j.name for j in report.joints] == ["a", "b"]
    assert report.passed


def test_stock_frictionloss_creeps():
    """Default solver settings: 1.6e-3 rad/s at J 0.2 and τ 0.3 N·m (sources.md 3.5)."""
    report = conformance(stock(0.3 / 0.9), rates=(0.02,))
    (joint,) = report.joints
    assert not report.passed
    assert not joint.holds
    assert joint.goes
    assert joint.creep > 1e-3
    assert joint.creep == pytest.approx(1.6e-3, rel=0.05)
    assert joint.still == pytest.approx(30 * joint.creep, rel=0.01)
    assert np.isnan(joint.presliding)


def test_chattering_bristle_fails():
    """σ1 under hσ0: the stuck joint chatters loose (sources.md 3.5)."""
    report = conformance(lugre("2000 1 0.5 0.6 0.003"), rates=NO_RAMP)
    assert not report.joints[0].holds


def test_overdamped_bristle_is_an_error_of_the_experiment(tmp_path, monkeypatch):
    """hσ1/J over 2 diverges: an error, not a joint that holds."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there
    with pytest.raises(ExperimentError, match="stopped by the engine"):
        conformance(lugre("2000 170 0.5 0.6 0.003"))


def test_joint_weaker_than_said_fails_and_stronger_too():
    """Against 0.7 N·m a joint of 0.6 does not hold; against 0.4 N·m it does not go."""
    weak = conformance(lugre(), [0.7], rates=NO_RAMP).joints[0]
    assert not weak.holds
    assert weak.goes
    strong = conformance(lugre(), [0.4], rates=(1.0,)).joints[0]
    assert strong.holds
    assert not strong.goes
    assert not strong.passed
    assert np.isnan(strong.go_time)


def test_one_weak_joint_fails_the_model():
    model = sticking(stiction=0.6).model
    report = conformance(model, [0.6, 0.8], rates=NO_RAMP)
    assert [j.passed for j in report.joints] == [True, False]
    assert not report.passed
    assert "1 of 2 joints stick" in str(report)
    assert "NO" in str(report)


IN_CONTACT = """
<mujoco><option timestep="0.001" integrator="Euler"/><worldbody><geom type="plane" size="2 2 .1"/>
  <body pos="0 0 0.1"><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0" mass="3"/></body>
  </worldbody><actuator><dcmotor joint="j" input="none" motorconst="0" resistance="1"
  lugre="2000 25 0.5 0.6 0.003"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    "text",
    [
        lugre(body='range="-10 10" limited="true"'),
        lugre(body='stiffness="50" springref="30"'),
        lugre(body='damping="0.2"'),
        IN_CONTACT,
    ],
    ids=["limits", "spring", "damping", "gravity and contact"],
)
def test_what_is_not_friction_does_not_hold_it(text):
    report = conformance(text, rates=NO_RAMP)
    assert report.passed, str(report)


def test_a_servo_does_not_hold_it():
    """A position actuator would hold even a creeping joint: it is switched off."""
    text = stock(actuator='<position joint="j" kp="1000"/>')
    (joint,) = conformance(text, rates=NO_RAMP).joints
    assert joint.creep > 1e-3
    assert joint.goes


def test_the_model_is_not_changed():
    text = lugre(body='stiffness="50" range="-10 10" limited="true"')
    model, before = (mujoco.MjModel.from_xml_string(text) for _ in range(2))
    conformance(model, rates=NO_RAMP)
    np.testing.assert_array_equal(model.opt.gravity, before.opt.gravity)
    assert model.opt.disableflags == before.opt.disableflags
    assert model.jnt_stiffness[0] == 50.0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"model": "atlas"}, "no such file, and no robot of that name"),
        ({"model": stock(), "stiction": [0.3, 0.3]}, r"shape \(2,\): .* one for each of 1 hinges"),
        (
            {"model": stock(), "stiction": [np.nan]},
            "stiction is nan: expected finite numbers from 0",
        ),
        ({"model": stock(), "stiction": [0.0]}, "carries friction"),
        ({"model": stock(), "rates": (0.1, 0.0)}, "must be positive"),
    ],
)
def test_bad_input(arguments, says):
    refusal(lambda: conformance(**arguments), says)
