"""A zero that is off: its torque against pendulums, and against the arm that stands elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.causes import Part
from stiction_envs.gap.causes.log.encoder_offset import EncoderOffset
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.robots import Arm, load_arm
from tests.gap.small_logs import data_of, hidden, panda

CAUSE = EncoderOffset()
MASS, LENGTH, G = 2.0, 0.4, 9.81
PENDULUM = f"""
<mujoco model="pendulum">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0 0 -{G}"/>
  <default><joint axis="0 1 0" range="-170 170"/></default>
  <worldbody>
    <body name="rod" pos="0 0 1" euler="0 0 40">
      <joint name="swing"/>
      <inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="1e-6 1e-6 1e-6"/>
      <body name="tip" pos="0.1 0 -0.5" euler="10 0 -25">
        <joint name="turn" pos="0.02 0 0.03"/>
        <inertial pos="0 0 -0.1" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>
        <site name="flange" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def pendulum(tmp_path: Path) -> Arm:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM, encoding="utf-8")
    return load_arm(path)


@pytest.fixture(scope="module")
def data() -> Data:
    return data_of(panda(), hidden(panda()))


def off_by(arm: Arm, offset: float, joint: int) -> Arm:
    part = Part(cause=CAUSE.name, joint=joint, shape=(offset,), coefficients=(offset,))
    return CAUSE.changed(arm, part)


@pytest.mark.parametrize("joint", range(1, 8))
def test_a_changed_arm_is_the_arm_at_another_angle(joint: int, data: Data) -> None:
    offset = 0.2
    there = data.q.copy()
    there[:, joint - 1] -= offset
    expected = inverse_dynamics(data.pinocchio, there, data.dq, data.ddq)
    model = off_by(data.arm, offset, joint).pinocchio()
    torque = inverse_dynamics(model, data.q, data.dq, data.ddq)
    np.testing.assert_allclose(torque, expected, atol=1e-9)
    own = CAUSE.columns(data, joint - 1, (offset,))[..., 0] * offset
    np.testing.assert_allclose(data.recording.rigid + own, expected, atol=1e-9)
    slope = CAUSE.columns(data, joint - 1, (0.0,))[..., 0]
    near = CAUSE.columns(data, joint - 1, (1e-5,))[..., 0]
    np.testing.assert_allclose(slope, near, atol=1e-3)


def test_angles_joint_axes_and_anchors_of_any_file_are_kept(pendulum: Arm) -> None:
    """Euler angles in degrees, an axis that is a default, an anchor away from the link's origin."""
    q, one = np.array([[0.3, -0.8]]), np.array([[1.0, 2.0]])
    for joint, moved in ((1, [[0.1, -0.8]]), (2, [[0.3, -1.0]])):
        torque = inverse_dynamics(off_by(pendulum, 0.2, joint).pinocchio(), q, one, one)
        expected = inverse_dynamics(pendulum.pinocchio(), np.array(moved), one, one)
        np.testing.assert_allclose(torque, expected, atol=1e-12)
