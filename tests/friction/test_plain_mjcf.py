"""What tells an exported model from ours."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.plain_mjcf import differences, plain_mjcf
from stiction_envs.friction.sticking import sticking_model
from tests.friction.gyro import sticking


def exported(model) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(plain_mjcf(model, friction_name="none"))


@pytest.mark.parametrize("ripple", [0.0, 0.01])
@pytest.mark.parametrize("elastic", [False, True])
def test_what_is_written_is_read_back(elastic, ripple):
    """Friction without ripple has periods all the same: 1 by default."""
    model = sticking(joint_stiffness=[8e3, np.inf] if elastic else np.inf, ripple_amplitude=ripple)
    assert max(differences(exported(model), model).values()) <= 1e-9


@pytest.mark.parametrize("field", ["body_mass", "dof_armature", "dof_damping"])
def test_differences_are_relative_to_the_number_itself(field):
    """A small joint's number counts as much as a large one's, down to a thousandth of it."""
    model = sticking_model("panda")
    again = exported(model)
    values = getattr(again, field)
    smallest = int(np.argmin(np.where(values > 1e-3 * values.max(), values, np.inf)))
    assert values[smallest] < 0.5 * values.max()
    values[smallest] *= 1 + 1e-6
    assert differences(again, model)[field] == pytest.approx(1e-6, rel=1e-3)


def test_every_field_is_compared_though_some_have_other_shapes():
    model = sticking(ripple_amplitude=0.01)
    again = exported(sticking(joint_stiffness=[8e3, np.inf], ripple_amplitude=0.01))
    found = differences(again, model)
    assert set(found) == set(differences(exported(model), model))
    assert found["jnt_stiffness"] == np.inf
    assert found["timestep"] == 0.0
