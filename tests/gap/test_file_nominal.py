"""`--nominal file`: friction, rotors, springs and gravity compensation of the robot's own file."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.gap.diagnose import default_nominal, diagnose
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.extended_model import extend
from stiction_envs.gap.model_file import nominal_of, read
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.questions import Servo, nominal_parameters
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import passive_torque
from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import load_arm
from tests.gap.servo.test_control_loops import pendulum_log
from tests.gap.small_logs import motion, write_model
from tests.robots.arms import chain

ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="l1" pos="0 0 0.1" gravcomp="0.5">
<joint name="a" axis="0 1 0" range="-2 2" armature="0.2" damping="0.8" {a}/>
<geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="2.5"/>
<body name="l2" pos="0 0 0.3"><joint name="b" axis="0 1 0" range="-2 2" armature="0.05"
stiffness="12" springref="0.4"/>
<geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.03" mass="1.6"/>
<body name="hand" pos="0.25 0 0" gravcomp="1"><geom size="0.04" mass="0.5"/></body>
</body></body></worldbody></mujoco>"""


def own_file(folder: Path, a: str = "") -> Path:
    """Write an arm with all that a file may state of its joints."""
    path = folder / "own.xml"
    path.write_text(ARM.format(a=a), "utf-8")
    return path


def log_of(path: Path, coulomb: float = 0.0) -> JointLog:
    """Return a log of the file in stock MuJoCo, by inverse dynamics, with dry friction on joint 1.

    The motion turns without presliding, as with frictionloss.
    """
    t, q, dq, ddq = motion(2, seconds=20.0)
    tau = inverse_torque(mujoco.MjModel.from_xml_path(str(path)), q, dq, ddq)
    tau[:, 0] += coulomb * np.sign(dq[:, 0])
    tau += 0.01 * np.random.default_rng(0).normal(size=tau.shape)
    return JointLog(source="made.csv", t=t, q=q, dq=None, tau=tau)


def data_of(path: Path, nominal: str, log: JointLog) -> Data:
    """Return a log against a nominal model."""
    arm, judged = nominal_of(path, nominal)
    return assemble(arm, prepare([log]), friction=judged.friction, of_file=judged.file)


def test_the_default_is_the_file_where_it_states_something(tmp_path: Path):
    path, log = own_file(tmp_path), tmp_path / "log.csv"
    log.write_text("t,q1,q2,tau1,tau2\n0,0,0,0,0\n", "utf-8")
    assert default_nominal([log], path) == "file"
    assert default_nominal([log], load_arm(path)) == "file"
    assert default_nominal([log], "panda") == "rigid"
    bare = tmp_path / "bare.xml"
    bare.write_text(chain(2).replace("<joint", '<joint armature="1"'), "utf-8")
    assert default_nominal([log], bare) == "rigid"


def test_the_nominal_torque_is_that_of_stock_mujoco(tmp_path: Path):
    """Rotors, damping, springs and gravcomp that differs by body: only noise is left."""
    path = own_file(tmp_path)
    log = log_of(path)
    left = data_of(path, "file", log).residual
    assert np.sqrt(np.mean(left**2, axis=0)).max() < 0.01
    # a rigid arm has the rotors, and lacks springs and compensation
    rigid = data_of(path, "rigid", log)
    np.testing.assert_array_equal(rigid.friction.rotor, [0.2, 0.05])
    assert not rigid.arm.stated.passive
    lacking = passive_torque(load_arm(path), rigid.q)[:, 1]
    assert np.std(rigid.residual[:, 1] - lacking) < 0.01 < np.std(lacking)


def test_behind_the_gear_no_rotor_is_seen(tmp_path: Path):
    path = own_file(tmp_path)
    arm, _ = nominal_of(path, "rigid")
    signals = prepare([log_of(path)])
    motor, link = (assemble(arm, signals, torque=side) for side in ("motor", "link"))
    np.testing.assert_allclose(motor.nominal - link.nominal, arm.stated.armature * motor.ddq)


def test_a_file_that_holds_the_truth_shows_no_discrepancy(tmp_path: Path):
    path = own_file(tmp_path, 'frictionloss="0.6"')
    found = diagnose_logs([log_of(path, 0.6)], path, nominal="file")
    assert found.verdict == "no discrepancy"
    assert not found.causes


def test_behind_the_gear_no_friction_of_the_file_is_seen(tmp_path: Path):
    path = own_file(tmp_path, 'frictionloss="0.6"')
    log = log_of(path)
    dq = np.gradient(log.q, log.t, axis=0)
    tau = log.tau - [0.8, 0.0] * dq - [0.2, 0.05] * np.gradient(dq, log.t, axis=0)
    log = replace(log, tau=tau)  # what a sensor behind the gear would measure
    found = diagnose(log, path, torque="link")
    assert not found.causes
    assert any("in front of the gear" in x for x in found.to_json()["notes"])


def test_a_wrong_friction_of_the_file_is_corrected(tmp_path: Path):
    path = own_file(tmp_path, 'frictionloss="1.4"')
    found = diagnose_logs([log_of(path, 0.6)], path, nominal="file")
    cause = next(c for c in found.causes if c.name == "coulomb_friction")
    low, high = cause.parameters[1]["coulomb_nm"].ci95
    assert low < 0.6 - 1.4 < high


def test_the_model_carries_what_the_file_states(tmp_path: Path):
    path = own_file(tmp_path, 'frictionloss="0.6"')
    log = log_of(path, 0.6)
    arm, judged = nominal_of(path, "file")
    made = extend(data_of(path, "file", log), judged)
    model = mujoco.MjModel.from_xml_string(made.xml)
    np.testing.assert_array_equal(model.jnt_stiffness, [0, 12])
    np.testing.assert_array_equal(model.qpos_spring, [0, 0.4])
    np.testing.assert_array_equal(model.dof_armature, [0.2, 0.05])
    np.testing.assert_array_equal(model.dof_damping, [0.8, 0])
    compensated = {model.body(b).name: model.body_gravcomp[b] for b in range(1, model.nbody)}
    assert compensated == {"l1": 0.5, "l2": 0, "hand": 1}
    # a later diagnosis begins with the same model
    again = read(write_model(tmp_path, replace(judged, robot=arm.name)))
    assert again.file
    later, _ = nominal_of(path, again)
    assert later.stated.passive
    rigid, judged = nominal_of(path, "rigid")
    assert not rigid.stated.passive
    # the arm of a rigid model has rotors
    made = extend(data_of(path, "rigid", log), judged)
    model = mujoco.MjModel.from_xml_string(made.xml)
    np.testing.assert_array_equal(model.dof_armature, rigid.stated.armature)
    assert not model.jnt_stiffness.any()


def test_a_servo_s_nominal_carries_what_the_file_s_gravcomp_does(tmp_path: Path):
    """Half of the only link's weight, along a motion that no joint's zero matters for."""
    path = tmp_path / "one.xml"
    path.write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body gravcomp="0.5">'
        '<joint name="a" axis="0 1 0" range="-2 2"/><geom pos="0.2 0 0" size="0.05" mass="2"/>'
        "</body></worldbody></mujoco>",
        "utf-8",
    )
    arm, t = load_arm(path), np.arange(0.0, 2.0, 0.02)
    q = 0.5 * np.sin(3.0 * t)[:, None]
    log = ServoLog(source="x", t=t, q=q, dq=None, breaks=(), q_cmd=q)
    found = nominal_parameters(
        Servo(stiffness=np.array([20.0]), arm=arm), joint_motions(arm, [log])
    )
    assert found[0, INDEX["compensation"]] == pytest.approx(0.5)


@pytest.mark.slow
def test_a_pendulum_under_a_position_servo(tmp_path: Path):
    """One hinge, by itself and before a joint without mass that does not move."""
    one = (
        '<mujoco><compiler angle="radian"/><worldbody><body name="arm">'
        '<joint name="hinge" axis="0 1 0" range="-3 3" {more}/>'
        '<inertial pos="0 0 -0.15" mass="0.741" diaginertia="1e-3 1e-3 1e-3"/>{tip}'
        "</body></worldbody></mujoco>"
    )
    tip = (
        '<body name="tip" pos="0 0 -0.2"><joint name="wrist" axis="1 0 0" range="-3 3"/>'
        '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    alone = pendulum_log(kp=15.0, kd=0.3, friction=0.08, rotor=0.01, seconds=30.0)
    known = {"servo_stiffness": [15.0], "servo_damping": [0.3]}
    for joints, text in ((1, one.format(more="", tip="")), (2, one.format(more="", tip=tip))):
        path = tmp_path / f"pendulum{joints}.xml"
        path.write_text(text, "utf-8")
        still = np.zeros((len(alone.t), joints - 1))
        log = replace(alone, q=np.hstack([alone.q, still]), q_cmd=np.hstack([alone.q_cmd, still]))
        found = diagnose(log, path, **known)
        (friction,) = (c for c in found.causes if c.name == "coulomb_friction")
        low, high = friction.parameters[1]["coulomb_nm"].ci95
        assert low - 0.005 < 0.08 < high + 0.005
        found.save(tmp_path / f"d{joints}")
        later = diagnose(log, path, nominal=tmp_path / f"d{joints}" / "model.toml")
        assert later.verdict == "no discrepancy"
    path.write_text(one.format(more='armature="0.01" frictionloss="0.08"', tip=""), "utf-8")
    names = {c.name for c in diagnose(alone, path, **known).causes}
    assert not names & {"coulomb_friction", "armature"}
