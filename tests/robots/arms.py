"""Small arms of our own in the structure of files that people bring along."""

from pathlib import Path

import mujoco
import numpy as np

from stiction_envs.robots import Arm

# As in MuJoCo Menagerie: defaults, actuators, a hand with two coupled fingers, a keyframe. Masses
# partly from geometry, one frame, one body without a name.
MJCF = """
<mujoco model="three">
  <compiler angle="degree" meshdir="assets"/>
  <option integrator="implicitfast" timestep="0.01"/>
  <default>
    <default class="arm">
      <joint armature="0.1" damping="2" frictionloss="0.3" stiffness="4" axis="0 0 1"
        range="-123.456789 120"/>
      <general dyntype="none" biastype="affine" ctrlrange="-2 2" forcerange="-87 87"/>
      <material specular="0.5"/>
      <default class="look"><geom material="white" contype="0" conaffinity="0" group="2"/></default>
      <default class="finger"><joint axis="0 1 0" type="slide" range="0 0.04"/></default>
    </default>
  </default>
  <asset>
    <material class="arm" name="white" rgba="1 1 1 1"/>
    <mesh file="tetra.obj"/>
  </asset>
  <contact><exclude body1="base" body2="one"/></contact>
  <worldbody>
    <light name="top" pos="0 0 2" mode="trackcom"/>
    <body name="base" childclass="arm" pos="0.1 0.2 0.3">
      <geom type="box" size="0.1 0.1 0.05"/>
      <frame pos="0 0 0.123456789" euler="10 0 0">
        <body name="one" gravcomp="1">
          <joint name="a"/>
          <geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.31234567891"/>
          <body pos="0 0 0.3" quat="1 -1 0 0">
            <joint name="b" pos="0 0.01 0" actuatorfrcrange="-55 55"/>
            <inertial pos="0 -0.1 0" mass="1.23456789012"
              fullinertia="0.02 0.03 0.04 0.001 0.002 0.003"/>
            <geom class="look" type="mesh" mesh="tetra"/>
            <body name="three" pos="0 -0.3 0" euler="90 0 12.3456789">
              <joint name="c" range="-30 90"/>
              <geom type="sphere" size="0.06" density="700"/>
              <body name="hand" pos="0 0 0.1">
                <geom type="box" size="0.05 0.1 0.02" mass="0.7"/>
                <site name="attachment_site" pos="0 0 0.05" euler="0 0 45"/>
                <body name="left" pos="0 0 0.05">
                  <joint name="left" class="finger"/>
                  <geom type="box" size="0.01 0.01 0.02" mass="0.015"/>
                </body>
                <body name="right" pos="0 0 0.05" quat="0 0 0 1">
                  <joint name="right" class="finger"/>
                  <geom type="box" size="0.01 0.01 0.02" mass="0.015"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <tendon><fixed name="split">
    <joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/>
  </fixed></tendon>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator>
    <general class="arm" name="a" joint="a" gainprm="4500" biasprm="0 -4500 -450"/>
    <motor class="arm" name="c" joint="c" gear="10" forcelimited="false"/>
    <general class="arm" name="grip" tendon="split" forcerange="-100 100"/>
  </actuator>
  <sensor><jointpos joint="a"/></sensor>
  <keyframe>
    <key name="other" qpos="0 0 0 0.01 0.02"/>
    <key name="home" qpos="0.1 0.2 0.3 0.04 0.04"/>
  </keyframe>
</mujoco>
"""

TETRA = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"

_INERTIAL = """<inertial><origin xyz="0.01 0 0.1" rpy="0.1 0.2 0.3"/><mass value="1.5"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0.001" ixz="0" iyz="0.002"/></inertial>"""

URDF = f"""
<robot name="two">
  <link name="base">{_INERTIAL}</link>
  <link name="upper">{_INERTIAL}
    <visual><geometry><mesh filename="package://nowhere/meshes/upper.dae"/></geometry></visual>
    <visual><geometry><cylinder radius="0.05" length="0.3"/></geometry></visual></link>
  <link name="lower">{_INERTIAL}
    <collision><geometry><mesh filename="package://two/assets/tetra.obj"/></geometry></collision>
  </link>
  <link name="tool0"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><dynamics damping="3" friction="1"/>
    <limit lower="-1.5" upper="2" effort="33" velocity="2.2"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.3" rpy="0.3 0 0"/><axis xyz="0 1 1"/></joint>
  <joint name="mount" type="fixed"><parent link="lower"/><child link="tool0"/>
    <origin xyz="0 0 0.25"/></joint>
</robot>
"""


def write_arms(folder: Path) -> Path:
    """Write ``three.xml``, ``two.urdf`` and their mesh into a folder; return it."""
    (folder / "assets").mkdir()
    (folder / "assets" / "tetra.obj").write_text(TETRA)
    (folder / "three.xml").write_text(MJCF)
    (folder / "two.urdf").write_text(URDF)
    return folder


def states(arm: Arm, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles within the limits, speeds and accelerations (count, n) [rad, s]."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(*arm.limits.position.T, (count, arm.n))
    dq, ddq = rng.uniform(-3, 3, (2, count, arm.n))
    return q, dq, ddq


def flange(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Pose (4, 4) of the end effector at angles (n,) [rad]."""
    model = arm.model()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    pose = np.eye(4)
    pose[:3, 3] = data.site(arm.end_effector).xpos
    pose[:3, :3] = data.site(arm.end_effector).xmat.reshape(3, 3)
    return pose


def chain(n: int, kind: str = "hinge", mass: str = "1", extra: str = "") -> str:
    """MJCF of ``n`` joints j1, j2, ... of one ``kind`` in a row, ``extra`` in the last link."""
    text = extra
    for i in range(n, 0, -1):
        text = (
            f'<body name="l{i}" pos="0 0 0.1"><joint name="j{i}" type="{kind}" axis="0 1 0"/>'
            f'<geom size="0.05" mass="{mass}"/>{text}</body>'
        )
    return f"<mujoco><worldbody>{text}</worldbody></mujoco>"


TWO = chain(2, extra='<geom pos="0.15 0 0.1" size="0.05" mass="1"/>')
"""MJCF of an arm of two joints that feel gravity: quick to simulate."""

RAIL = """<mujoco><compiler angle="radian"/><worldbody><body name="rail">
<joint name="lift" type="slide" axis="0 0 1" range="0.1 0.5"/><geom size="0.1" mass="3"/>
<body name="one" pos="0 0 0.2"><joint name="a" axis="0 0 1"/><geom size="0.1" mass="2"/>
<body name="two" pos="0.3 0 0"><joint name="b" axis="0 1 0" range="-2 2"/>
<geom size="0.1" mass="1"/></body></body></body></worldbody></mujoco>"""
"""MJCF of two hinges on a slide."""
