"""The controller's model of the dynamics is MuJoCo's of the arm that it has."""

import mujoco
import numpy as np
import pytest

from stiction_envs.experiments.gte.loop import ControllerModel, renew_dynamics, renew_torques
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.robots import Arm, load_arm

N = 3


def bias(arm: Arm, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return inertia and torque of gravity and speeds of one arm."""
    model = arm.bare_model()
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:], data.qvel[:] = q, dq
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    return mass, data.qfrc_bias.copy()


@pytest.mark.parametrize("payload", [None, (1.0, 0.0, 0.0, 0.1)])
def test_inertia_gravity_and_speeds_are_those_of_the_arm_that_it_has(payload):
    sticking = sticking_model("panda")
    arm = load_arm("panda", payload=payload)
    model = ControllerModel(arm, sticking, N)
    rng = np.random.default_rng(0)
    q = sticking.arm.rest + 0.2 * rng.normal(size=(N, 7))
    dq, gravity, coriolis = rng.normal(size=(N, 7)), *np.zeros((2, N, 7))
    for i in range(N):
        renew_dynamics(i, q, model.arrays())
        renew_torques(i, q, dq, model.arrays().believed, gravity, coriolis)
    assert model.is_wrong == (payload is not None)
    for i in range(N):
        mass, weight = bias(arm, q[i], np.zeros(7))
        rotors = np.diag(sticking.parameters.rotor_inertia)
        np.testing.assert_allclose(model.mass[i], mass + rotors, rtol=0, atol=1e-14)
        np.testing.assert_allclose(gravity[i], weight, rtol=0, atol=1e-13)
        np.testing.assert_allclose(gravity[i] + coriolis[i], bias(arm, q[i], dq[i])[1], atol=1e-12)
        true = bias(sticking.arm, q[i], np.zeros(7))[1]
        np.testing.assert_allclose(model.missing[i], weight - true, rtol=0, atol=1e-13)


def test_an_arm_without_angles_keeps_its_last_and_parts_have_data_of_their_own():
    sticking = sticking_model("panda")
    model = ControllerModel(sticking.arm, sticking, N)
    q = np.tile(sticking.arm.rest, (N, 1))
    for part in (0, 1):
        for i in range(N):
            renew_dynamics(i, q, model.arrays(part))
        before = model.mass.copy()
        q[1], q[2] = np.nan, sticking.arm.rest + 0.1
    np.testing.assert_array_equal(model.mass[:2], before[:2])
    assert np.abs(model.mass[2] - model.mass[0]).max() > 1e-3
    assert model.arrays(1).believed.data != model.arrays(0).believed.data
