"""Servos that hold an arm: as stiff as its friction asks for, damped as far as the step allows."""

import numpy as np
import pytest

from stiction_envs.experiments.holding_servos import Servos
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.plant import Plant
from stiction_envs.robots import ARMS, load_arm

LIGHT = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <default><joint axis="0 1 0" range="-3 3" actuatorfrcrange="-{limit} {limit}"/></default>
  <worldbody><body name="one"><joint name="a"/>
    <inertial mass="0.3" pos="0 0 0.1" diaginertia="1e-3 1e-3 1e-4"/>
    <body name="two" pos="0 0 0.2"><joint name="b"/>
      <inertial mass="0.1" pos="0 0 0.1" diaginertia="1e-4 1e-4 1e-5"/>
    </body></body></worldbody>
</mujoco>
"""
BENT = np.array([[0.3, 1.2], [0.0, 0.0], [-1.0, 2.5]])


@pytest.fixture
def light(tmp_path):
    """Make a light arm of two joints, without rotors, of a torque limit and a stiction [N·m]."""

    def make(limit=100.0, stiction=0.02, rotor=0.0):
        path = tmp_path / f"light{limit}.xml"
        path.write_text(LIGHT.format(limit=limit), encoding="utf-8")
        friction = load_friction("generic", 2).rigid()
        friction = friction.replace(
            stiction=np.full((2, 2), stiction),
            bristle_stiffness=np.full(2, 0.2),
            rotor_inertia=np.full(2, rotor),
            viscous=np.zeros((2, 2)),
        )
        return build(load_arm(path), friction)

    return make


@pytest.mark.parametrize("robot", ARMS)
def test_a_heavy_arm_is_damped_critically_as_stiff_as_its_torque_limit(robot):
    """Limit case: neither friction nor the step has a say."""
    arm = load_arm(robot)
    sticking, p = build(arm), load_protocol(robot)
    servos = Servos(sticking, p)
    plant = Plant(sticking, 1, threads=1)
    stiffness = servos.stiffness(servos.resistance(*plant.load))
    np.testing.assert_array_equal(stiffness[0], p.hold_stiffness * arm.limits.torque)
    inertia, mass = servos.inertia(arm.rest[None])
    np.testing.assert_array_equal(
        servos.damping(stiffness, inertia, mass), 2 * np.sqrt(stiffness * inertia)
    )


def test_a_light_arm_comes_to_rest_where_it_is_held(light):
    """Joints released 0.1 rad off come back; critically damped, they do not."""
    sticking = light()
    servos = Servos(sticking, load_protocol("own"))
    stiffness, inertia = servos.stiffness(np.zeros(BENT.shape)), servos.inertia(BENT)

    def left(damping):
        plant = Plant(sticking, len(BENT), threads=1)
        plant.reset(np.arange(3), BENT + 0.1)
        plant.set_servo(np.arange(3), stiffness, damping, BENT)
        late = plant.run(np.zeros((3, 2000, 2)))[:, 1500:]
        return np.abs(late - BENT[:, None]).max()

    assert left(servos.damping(stiffness, *inertia)) < 1e-3
    assert left(2 * np.sqrt(stiffness * inertia[0])) > 0.1


def test_friction_near_the_torque_limit_does_not_keep_a_joint_from_its_pose(light):
    """Friction takes half of a limit of 1 N·m, as in a gripper: 1.2 N·m/rad would leave 0.4 rad."""
    sticking = light(limit=1.0, stiction=0.5, rotor=0.1)
    p = load_protocol("own")
    servos = Servos(sticking, p)
    plant = Plant(sticking, 1, threads=1)
    resistance = servos.resistance(*plant.load)
    np.testing.assert_allclose(resistance, 0.5)
    stiffness = servos.stiffness(resistance)
    assert (resistance / stiffness < p.start_tolerance).all()
    damping = servos.damping(stiffness, *servos.inertia(np.zeros((1, 2))))
    plant.reset(np.array([0]), [[0.15, 0.15]])
    plant.set_servo(np.array([0]), stiffness, damping, 0.0)
    at = plant.run(np.zeros((1, 3000, 2)))[0, -1]
    assert (np.abs(at) < p.start_tolerance).all()
