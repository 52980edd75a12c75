"""One serial arm of a bigger robot: the others are locked where it rests, and still weigh."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.refusal import refusal

ARM = """
<body name="{side}_mount" pos="0 {y} 0.1" euler="10 20 30">
  <body name="{side}_1" euler="40 0 0">
    <joint name="{side}_a" axis="0 1 0"/><geom size="0.03" fromto="0 0 0 0.1 0 0"/>
    <frame pos="0.1 0 0" euler="0 30 0">
      <body name="{side}_2" euler="0 0 15">
        <joint name="{side}_b" axis="0 1 1" pos="0 0 0.02"/>
        <geom size="0.03" fromto="0 0 0 0.1 0 0"/>
        <body name="{side}_hand" pos="0.12 0 0">
          <joint name="{side}_c" range="0.2 1"/>
          <geom type="sphere" size="0.02"/><site name="{side}_grasp" pos="0.02 0 0"/>
          <body name="{side}_finger" pos="0.05 0 0">
            <joint name="{side}_f" type="slide" axis="1 0 0" range="0 0.04"/>
            <geom type="box" size="0.01 0.01 0.01"/>
          </body>
        </body>
      </body>
    </frame>
  </body>
</body>
"""
ROBOT = f"""
<mujoco model="two_arms">
  <compiler angle="radian" eulerseq="zyx"/>
  <default><geom type="capsule"/></default>
  <worldbody>
    <body name="wheels" pos="0 0 0.2">
      <freejoint/><geom type="box" size="0.1 0.1 0.1"/>
      <body name="torso" pos="0 0 0.2">
        <joint name="lift" type="slide" axis="0 0 1" range="0.05 0.3"/>
        <geom type="box" size="0.1 0.1 0.2"/>
        {ARM.format(side="left", y=0.3)}{ARM.format(side="right", y=-0.3)}
      </body>
    </body>
    <body name="table" pos="1 0 0"><geom type="box" size="0.1 0.1 0.1"/></body>
    <body name="ball" pos="2 0 1"><freejoint/><geom type="sphere" size="0.1"/></body>
  </worldbody>
  <contact><exclude body1="ball" body2="torso"/></contact>
  <tendon><fixed name="both">
    <joint joint="left_f" coef="1"/><joint joint="right_f" coef="1"/>
  </fixed></tendon>
  <equality><joint joint1="left_f" joint2="right_f"/></equality>
  <actuator>
    <motor joint="left_a" ctrlrange="-7 7"/><motor joint="right_a" ctrlrange="-9 9"/>
    <motor joint="left_b" ctrlrange="-5 5"/><motor tendon="both"/>
  </actuator>
  <sensor><jointpos joint="right_a"/><framepos objtype="body" objname="ball"/></sensor>
</mujoco>
"""
HOME = "0 0 0.2 1 0 0 0 0.1 0.4 0.5 0.6 0.03 -0.4 -0.5 0.7 0.01 2 0 1 1 0 0 0"
"""Free base, lift, left a b c f, right a b c f, ball."""


def write(folder: Path, *, home: bool) -> Path:
    key = f'<keyframe><key name="home" qpos="{HOME}"/></keyframe></mujoco>'
    path = folder / "two_arms.xml"
    path.write_text(ROBOT.replace("</mujoco>", key) if home else ROBOT, "utf-8")
    return path


@pytest.mark.parametrize("home", [True, False])
def test_the_arm_stands_and_weighs_as_in_the_whole_robot(tmp_path: Path, home: bool):
    """The law: with the other joints held at rest, pose and gravity torque are the whole's."""
    path = write(tmp_path, home=home)
    arm = load_arm(path, chain=("torso", "right_grasp"))
    assert arm.joint_names == ("right_a", "right_b", "right_c")
    assert arm.end_effector == "right_grasp"
    assert arm.name == "two_arms-torso-right_grasp"
    assert arm.limits.torque[0] == 9
    whole, model = mujoco.MjModel.from_xml_path(str(path)), arm.model()
    one, two = mujoco.MjData(whole), mujoco.MjData(model)
    if home:
        one.qpos[:] = whole.key_qpos[0]
        np.testing.assert_allclose(arm.rest, [-0.4, -0.5, 0.7])
    else:
        one.qpos[whole.joint("lift").qposadr] = 0.05  # zero is outside of its range
        one.qpos[whole.joint("left_c").qposadr] = 0.2
    at = [int(whole.joint(name).qposadr[0]) for name in arm.joint_names]
    dof = [int(whole.joint(name).dofadr[0]) for name in arm.joint_names]
    for q in np.random.default_rng(0).uniform(-1, 1, (5, 3)):
        one.qpos[at], two.qpos[:] = q, q
        mujoco.mj_forward(whole, one)
        mujoco.mj_forward(model, two)
        for name in ("right_hand", "left_finger", "right_finger", "table"):
            np.testing.assert_allclose(two.body(name).xpos, one.body(name).xpos, atol=1e-12)
            np.testing.assert_allclose(two.body(name).xmat, one.body(name).xmat, atol=1e-12)
        np.testing.assert_allclose(two.qfrc_bias, one.qfrc_bias[dof], atol=1e-12)
    assert "ball" not in arm.link_names
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "ball") == -1
    gone = whole.body("ball").mass[0]
    assert model.body_mass.sum() == pytest.approx(whole.body_mass.sum() - gone)


def test_a_tip_without_a_site_is_the_flange(tmp_path: Path):
    arm = load_arm(write(tmp_path, home=False), chain=("left_mount", "left_2"))
    assert arm.joint_names == ("left_a", "left_b")
    assert load_arm(tmp_path / "two_arms.xml", chain=("left_1", "left_2")).n == 1
    data = mujoco.MjData(arm.model())
    mujoco.mj_kinematics(arm.model(), data)
    np.testing.assert_allclose(data.site(arm.end_effector).xpos, data.body("left_2").xpos)


@pytest.mark.parametrize(
    ("chain", "says"),
    [
        (
            ("torso", "right_gripper"),
            "no link 'right_gripper': expected one of wheels, torso, l",
        ),
        (("right_hand", "torso"), "link 'torso' is not behind link 'right_hand'"),
        (("torso", "torso"), "link 'torso' is not behind link 'torso'"),
        (("torso",), "expected two links, base and tip"),
        ("torso", "expected two links, base and tip"),
    ],
)
def test_bad_chains_are_refused(tmp_path: Path, chain, says: str):
    path = write(tmp_path, home=False)
    refusal(lambda: load_arm(path, chain=chain), says)


def test_a_bigger_robot_names_its_arms(tmp_path: Path):
    path = write(tmp_path, home=False)
    assert refusal(lambda: load_arm(path)).endswith(
        "; of a bigger robot take one arm: chain left_mount left_hand (or right_mount right_hand)"
    )
    for base, tip in (("left_mount", "left_hand"), ("right_mount", "right_hand")):
        assert load_arm(path, chain=(base, tip)).n == 3


def test_an_impossible_inertia_of_a_fixed_body_does_not_matter(tmp_path: Path):
    bad = '<inertial pos="0 0 0" mass="1e-6" fullinertia="1e-6 1e-6 1e-6 1e-6 1e-6 1e-6"/>'
    path = tmp_path / "bad.xml"
    links = '<body name="l{}" pos="0 0 0.1"><joint/><geom size="0.05"/>'
    inner = links.format(1) + links.format(2) + "</body></body>"
    path.write_text(
        f'<mujoco><worldbody><body name="base">{bad}{inner}</body></worldbody></mujoco>', "utf-8"
    )
    assert load_arm(path).n == 2
    path.write_text(path.read_text("utf-8").replace('<body name="l2"', f'{bad}<body name="l2"'))
    refusal(lambda: load_arm(path), "'l1'")
