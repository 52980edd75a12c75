"""Differences of an exported model from the simulated one."""

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.export import plain_mjcf
from stiction_envs.robots.stated import COULOMB, STICTION, STRIBECK
from tests.friction.gyro import differences, sticking


def exported(model) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(plain_mjcf(model, friction_name="none"))


@pytest.mark.parametrize("ripple", [0.0, 0.01])
@pytest.mark.parametrize("elastic", [False, True])
def test_what_is_written_is_read_back(elastic, ripple):
    """Friction without ripple has periods all the same: 1 by default."""
    model = sticking(joint_stiffness=[8e3, np.inf] if elastic else np.inf, ripple_amplitude=ripple)
    found = exported(model)
    assert max(differences(found, model).values()) <= 1e-9
    levels = found.actuator_biasprm[:, [COULOMB, STICTION, STRIBECK]]
    np.testing.assert_allclose(levels, [[0.8 * 0.6, 0.6, 0.01]] * 2)


def pushed(model: mujoco.MjModel, torque: float, steps: int = 500) -> np.ndarray:
    """Return the path of the first joint under a constant control, (steps,) [rad]."""
    data, out = mujoco.MjData(model), np.empty(steps)
    data.ctrl[0] = torque
    for k in range(steps):
        mujoco.mj_step(model, data)
        out[k] = data.qpos[0]
    return out


def test_a_volt_is_a_newton_metre():
    """A motor driven by voltage moves as one by torque: its winding damps by 1e-6 N·m·s/rad."""
    model = sticking(stiction=0.5, ripple_amplitude=0.01)
    text = plain_mjcf(model, friction_name="none", motor="voltage")
    one, other = exported(model), mujoco.MjModel.from_xml_string(text)
    for torque in (0.4, 0.8):
        path = pushed(one, torque)
        assert abs(path[-1]) > (0.1 if torque > 0.5 else 1e-5)
        np.testing.assert_allclose(pushed(other, torque), path, rtol=1e-4, atol=1e-9)


def test_frictionloss_has_the_same_names_and_the_breakaway_torque():
    model = sticking(joint_stiffness=[8e3, np.inf], stiction=[[0.5, 0.5], [0.3, 0.3]])
    text = plain_mjcf(model, friction_name="none", kind="frictionloss")
    one, other = exported(model), mujoco.MjModel.from_xml_string(text)
    for count, kind in ((one.njnt, "joint"), (one.nu, "actuator"), (one.nbody, "body")):
        names = [[getattr(m, kind)(k).name for k in range(count)] for m in (one, other)]
        assert names[0] == names[1]
    np.testing.assert_allclose(other.dof_frictionloss[model.motor], [0.5, 0.3])
    assert other.dof_frictionloss[model.spring[0]] == 0.0
    np.testing.assert_array_equal(one.dof_damping, other.dof_damping)
    np.testing.assert_array_equal(one.actuator_ctrlrange, other.actuator_ctrlrange)
    lost = text.split("-->")[0]
    assert lost.count("--") == 1  # none inside the comment
    for word in ("presliding", "Stribeck", "ripple", "creeps", "on load"):
        assert word in " ".join(lost.split())
