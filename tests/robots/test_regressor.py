"""The regressor is inverse dynamics; base parameters are what torques can show; pseudo-inertias."""

import numpy as np
import pytest

from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.robots import BUILTIN, load_arm
from stiction_envs.robots.regressor import (
    PARAMETERS,
    base_set,
    consistent,
    from_pseudo_inertia,
    inertial_names,
    inertial_parameters,
    pseudo_inertia,
    torque_regressor,
)
from tests.robots.arms import states


@pytest.mark.parametrize("options", [{}, {"payload": (1.2, 0.01, 0.02, 0.06), "tilt": (0.2, -0.3)}])
@pytest.mark.parametrize("name", BUILTIN)
def test_regressor_times_parameters_is_mujocos_inverse_dynamics(name, options):
    arm = load_arm(name, **options)
    motion, pinocchio = states(arm, 60), arm.pinocchio()
    tau = torque_regressor(pinocchio, *motion) @ inertial_parameters(pinocchio).ravel()
    np.testing.assert_allclose(tau, inverse_torque(arm.model(), *motion), atol=1e-9)


@pytest.mark.parametrize("name", BUILTIN)
def test_base_parameters_give_all_torque(name):
    """43 of 70 parameters fix the torque of an upright seven-joint arm (Gaz et al. 2019)."""
    arm = load_arm(name)
    model = arm.pinocchio()
    w = torque_regressor(model, *states(arm, 200)).reshape(-1, 70)
    base = base_set(w, inertial_names(7))
    assert base.size == 43
    other = torque_regressor(model, *states(arm, 50, seed=9)).reshape(-1, 70)
    rng = np.random.default_rng(1)
    for phi in rng.normal(size=(3, 70)):
        np.testing.assert_allclose(other[:, base.kept] @ base.values(phi), other @ phi, atol=1e-8)


def test_grouping_of_the_panda_is_the_textbooks():
    """Denavit-Hartenberg rules: masses behind link 3 hang on its elbow offset of 82.5 mm."""
    arm = load_arm("panda")
    w = torque_regressor(arm.pinocchio(), *states(arm, 200)).reshape(-1, 70)
    base = base_set(w, inertial_names(7))
    said = base.expressions()
    assert "mx3 + 0.0825 m4 + 0.0825 m5 + 0.0825 m6 + 0.0825 m7" in said
    assert "mx6 + 0.088 m7" in said
    assert "Izz7" in said
    on_nothing = base.dropped[~base.grouping.any(axis=0)]
    assert {"m1", "mx1", "my1", "mz1", "Ixx1"} <= {base.names[k] for k in on_nothing}
    assert len(inertial_names(7)) == 7 * len(PARAMETERS)


def test_point_masses_give_the_pseudo_inertia():
    """J = Σ m (x, 1)(x, 1)ᵀ, and φ from the definition of mass, moment and inertia."""
    rng = np.random.default_rng(0)
    masses, points = rng.uniform(0.1, 1, 6), rng.normal(size=(6, 3))
    homogeneous = np.hstack([points, np.ones((6, 1))])
    j = np.einsum("k,ka,kb->ab", masses, homogeneous, homogeneous)
    inertia = sum(
        m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, points, strict=True)
    )
    first = masses @ points
    rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
    phi = np.concatenate([[masses.sum()], first, inertia[rows, columns]])
    np.testing.assert_allclose(pseudo_inertia(phi), j, atol=1e-12)
    np.testing.assert_allclose(from_pseudo_inertia(j), phi, atol=1e-12)
    assert consistent(phi)
