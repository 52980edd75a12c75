"""Joint properties in a robot's file are read; the notes list what is left out."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.robots import Arm, load_arm
from tests.refusal import refusal
from tests.robots.arms import RAIL, URDF

PARTS = {
    "a": '<joint name="a" axis="0 1 0" range="-2 2"/>',
    "b": '<joint name="b" axis="0 1 0" range="-2 2"/>',
    "tip": "",
    "more": "",
}
ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="base"><geom size="0.1" mass="5"/><site name="s" pos="0.2 0 0"/>
    <body name="one">{a}<geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="2"/>
      <body name="two" pos="0 0 0.3">{b}<geom size="0.05" pos="0 0 0.1" mass="1"/>
        <site name="e"/>{tip}</body></body></body>
</worldbody>{more}</mujoco>
"""


def arm_of(tmp_path: Path, **parts: str) -> Arm:
    path = tmp_path / "own.xml"
    path.write_text(ARM.format(**PARTS | parts), "utf-8")
    return load_arm(path)


def test_an_arm_of_the_package_states_nothing():
    stated = load_arm("panda").stated
    assert not stated.friction
    assert not stated.passive
    assert not stated.armature.any()
    assert stated.line() == ""


def test_joints_state_rotor_friction_and_springs(tmp_path: Path):
    a = '<joint name="a" axis="0 1 0" armature="0.2" damping="0.5" frictionloss="1.1"/>'
    b = '<joint name="b" axis="0 1 0" stiffness="25" springref="0.3"/>'
    arm = arm_of(tmp_path, a=a, b=b)
    s = arm.stated
    for found, right in (
        (s.armature, [0.2, 0]),
        (s.damping, [0.5, 0]),
        (s.stiction, [1.1, 0]),
        (s.coulomb, [1.1, 0]),
        (s.stiffness, [0, 25]),
        (s.springref, [0, 0.3]),
    ):
        np.testing.assert_array_equal(found, right)
    assert s.line().startswith(
        "taken from the file: rotor inertia 0.2 0 kg·m², dry friction 1.1 0 N·m, "
        "damping 0.5 0 N·m·s/rad, springs 0 25 N·m/rad"
    )
    assert s.line(used=False).startswith(
        "taken from the file: rotor inertia 0.2 0 kg·m²; left out: dry friction 1.1 0 N·m, "
    )
    # the arm itself stays rigid
    assert not arm.model().dof_damping.any()
    assert not arm.model().jnt_stiffness.any()


def test_actuators_and_fixed_tendons_add_to_their_joint(tmp_path: Path):
    more = """<tendon>
      <fixed name="t" stiffness="10" springlength="0.2" damping="1" frictionloss="0.3">
        <joint joint="b" coef="2"/></fixed>
      <spatial name="balancer" stiffness="800"><site site="s"/><site site="e"/></spatial></tendon>
      <actuator><motor joint="a" gear="100" armature="0.001" damping="0.01"/>
      <dcmotor joint="b" motorconst="1" resistance="1" input="ff" gear="2"
        lugre="100 1 0.5 0.6 0.01"/></actuator>"""
    s = arm_of(tmp_path, more=more).stated
    np.testing.assert_allclose(s.armature, [10, 0])
    np.testing.assert_allclose(s.damping, [100, 4])
    np.testing.assert_allclose(s.stiffness, [0, 40])
    np.testing.assert_allclose(s.springref, [0, 0.1])
    np.testing.assert_allclose(s.stiction, [0, 1.2 + 0.6])
    np.testing.assert_allclose(s.coulomb, [0, 1.0 + 0.6])
    np.testing.assert_allclose(s.bristle, [0, 400])
    np.testing.assert_allclose(s.stribeck, [0, 0.005])
    assert "tendon 'balancer' (stiffness 800)" in s.line()


def test_servos_are_left_out_and_said(tmp_path: Path):
    more = (
        '<actuator><position joint="a" kp="200" kv="3"/><position joint="b" kp="100"/></actuator>'
    )
    line = arm_of(tmp_path, more=more).stated.line()
    assert "left out: position servos (kp 200 100, kv 3 0)" in line


def test_gravity_compensation_is_that_of_bodies_that_move(tmp_path: Path):
    tip = '<body name="hand" gravcomp="0.5"><geom size="0.02" mass="0.3"/></body>'
    more = '<worldbody><body name="desk" gravcomp="1"><geom size="0.1"/></body></worldbody>'
    assert arm_of(tmp_path, tip=tip, more=more).stated.gravcomp == {"hand": 0.5}


LOOP = '<equality><connect body1="two" body2="base" anchor="0 0 0.1"/></equality>'
COUPLED = '<equality><joint name="c" joint1="b" joint2="a" polycoef="0 -1 0 0 0"/></equality>'


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (LOOP, r"connect equality \(a mimic or closed loop\) ties two to base"),
        (COUPLED, r"joint equality 'c' \(a mimic or closed loop\) ties b to a"),
        ('<equality><weld body1="two"/></equality>', "weld equality .* ties two to world"),
    ],
)
def test_loops_and_mimics_are_refused(tmp_path: Path, more: str, says: str):
    refusal(lambda: arm_of(tmp_path, more=more), says)


def test_a_mimic_of_a_urdf_is_refused(tmp_path: Path):
    path = tmp_path / "mimic.urdf"
    elbow = '<joint name="elbow" type="continuous">'
    mimic = URDF.replace(elbow, f'{elbow}<mimic joint="shoulder" multiplier="-1"/>')
    path.write_text(mimic, "utf-8")
    refusal(lambda: load_arm(path), "ties elbow to shoulder")


def test_constraints_that_hold_no_joint_are_said(tmp_path: Path):
    tip = "".join(
        f'<body name="{x}"><joint name="{x}" type="slide"/><geom size="0.02" mass="0.1"/></body>'
        for x in ("left", "right")
    )
    fingers = '<equality><joint joint1="left" joint2="right"/></equality>'
    line = arm_of(tmp_path, tip=tip, more=fingers).stated.line()
    assert "joints held still: left, right" in line
    assert "joint equality" in line
    follows = '<equality><joint joint1="left" joint2="b"/></equality>'
    assert "joint equality" in arm_of(tmp_path, tip=tip, more=follows).stated.line()
    off = LOOP.replace("<connect", '<connect active="false"')
    assert "left out: connect equality" in arm_of(tmp_path, more=off).stated.line()


def test_a_slide_between_hinges_is_held_where_it_rests(tmp_path: Path):
    path = tmp_path / "slide.xml"
    path.write_text(RAIL, "utf-8")
    arm = load_arm(path)
    assert arm.joint_names == ("a", "b")
    assert arm.stated.held == ((0, "lift"),)
    assert "joints held still: lift" in arm.notes()[0]
    model = arm.model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("two").xpos, [0.3, 0, 0.3])
    assert load_arm(path, chain=("rail", "two")).stated.held == ()  # not between these links
    assert load_arm(path, chain=("world", "two")).stated.held == ((0, "lift"),)


MINI = """<robot name="mini">{mujoco}
<link name="base"/>
<link name="l1"><inertial><mass value="1.5"/><origin xyz="0.1 0 0"/>
<inertia ixx="0.0025" ixy="0" ixz="0" iyy="0.006" iyz="0" izz="0.0095"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="3"/></joint></robot>"""


@pytest.mark.parametrize("says", ['<mujoco><compiler balanceinertia="true"/></mujoco>', ""])
def test_an_inertia_that_no_body_can_have_is_balanced_and_said(tmp_path: Path, says: str):
    path = tmp_path / "mini.urdf"
    path.write_text(MINI.format(mujoco=says), "utf-8")
    arm = load_arm(path)
    np.testing.assert_allclose(arm.model().body("l1").inertia, 0.006)  # as MuJoCo does it
    assert "inertia of l1 balanced: 0.0025 0.006 0.0095 becomes 0.006" in arm.stated.line()


def test_the_compiler_element_of_a_urdf_is_honoured(tmp_path: Path):
    path = tmp_path / "mini.urdf"
    heavy = '<mujoco><compiler balanceinertia="true" settotalmass="6"/></mujoco>'
    path.write_text(MINI.format(mujoco=heavy), "utf-8")
    assert load_arm(path).model().body_mass.sum() == pytest.approx(6)


def test_physics_of_the_whole_file_that_is_left_out_is_said(tmp_path: Path):
    more = """<option density="1.2"><flag gravity="disable" spring="disable"/></option>
      <actuator><motor joint="a" damping="1 2"/></actuator>"""
    b = '<joint name="b" axis="0 1 0" stiffness="25 1"/>'
    line = arm_of(tmp_path, b=b, more=more).stated.line()
    assert "the higher terms of damping, the higher terms of stiffness, option density" in line
    assert "option density, gravity off, spring off" in line
    assert "higher" not in arm_of(tmp_path).stated.line()
