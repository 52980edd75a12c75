"""From names, arms and friction to models: which friction counts, and what tells models apart."""

import numpy as np
import pytest

from stiction_envs.friction.parameters import QUANTITIES, load_friction
from stiction_envs.friction.sticking import arm_of, model_sha256, sticking_model, with_rotors
from stiction_envs.robots import load_arm
from tests.friction.gyro import friction, gyro, sticking


def test_a_model_keeps_its_friction_and_its_step_unless_told():
    model = sticking(timestep=5e-4)
    assert sticking_model(model) is model
    assert arm_of(model) is model.arm
    assert sticking_model(model, timestep=2.5e-4).timestep == 2.5e-4
    other = sticking_model(model, friction(stiction=0.9))
    assert other.timestep == 5e-4
    np.testing.assert_array_equal(other.parameters.stiction, 0.9)
    assert sticking_model(gyro(), friction()).timestep == 1e-3


def test_rotors_come_from_the_arm_only_where_there_are_none():
    arm = load_arm("panda")
    own = load_friction("panda")
    given = own.rotor_inertia.copy()
    given[[0, 4]], given[2] = 0.0, 0.9
    found = with_rotors(own.replace(rotor_inertia=given), arm).rotor_inertia
    assert found[2] == 0.9
    np.testing.assert_array_equal(np.delete(found, 2), np.delete(own.rotor_inertia, 2))
    assert (found > 0).all()


@pytest.mark.parametrize("name", QUANTITIES)
def test_every_number_of_the_friction_is_in_the_hash(name):
    model = sticking(joint_stiffness=8e3)
    value = getattr(model.parameters, name)
    change = np.full_like(value, 7.0) if name == "load_high" else 0.95 * value + 1e-3
    changed = sticking_model(model, model.parameters.replace(**{name: change}))
    assert model_sha256(changed) != model_sha256(model)
