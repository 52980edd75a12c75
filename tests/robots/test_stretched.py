"""Small errors of links: the tangent of J' = A J Aᵀ, and what one standard deviation is."""

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from stiction_envs.robots.consistent import (
    STRETCH_SD,
    nearest_bodies,
    stretch_directions,
    tolerances,
)
from stiction_envs.robots.regressor import (
    consistent,
    from_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
)

LINKS = inertial_parameters(load_arm("panda").pinocchio())


@pytest.mark.parametrize("link", range(7))
def test_the_directions_are_the_tangent_of_a_stretched_body(link: int) -> None:
    """A mass, a shift, a stretch and a shear of a millionth, written out here once more."""
    phi, small = LINKS[link], 1e-6
    to = np.eye(4)
    to[:3, 3] = phi[1:4] / phi[0]
    inner = {0: np.eye(4) * np.sqrt(1 + small), 2: np.eye(4), 5: np.eye(4), 8: np.eye(4)}
    inner[2][1, 3] = small
    inner[5][1, 1] += small
    inner[8][0, 2] = inner[8][2, 0] = small
    for k, a in inner.items():
        a = to @ a @ np.linalg.inv(to)
        moved = from_pseudo_inertia(a @ pseudo_inertia(phi) @ a.T)
        assert np.allclose((moved - phi) / small, stretch_directions(phi)[:, k], atol=1e-5)


def test_one_standard_deviation_is_a_tenth_of_the_mass_and_15_mm() -> None:
    spread = tolerances(LINKS) @ tolerances(LINKS).T
    for k, phi in enumerate(LINKS):
        own = spread[10 * k : 10 * k + 10, 10 * k : 10 * k + 10]
        assert np.isclose(np.sqrt(own[0, 0]), 0.1 * phi[0])
        slope = np.zeros((3, 10))
        slope[:, 0], slope[:, 1:4] = -phi[1:4] / phi[0] ** 2, np.eye(3) / phi[0]
        centre = np.sqrt(np.diag(slope @ own @ slope.T))
        assert np.allclose(centre, 0.015)
        rest = np.delete(spread[10 * k : 10 * k + 10], np.s_[10 * k : 10 * k + 10], axis=1)
        assert not rest.any()
    assert STRETCH_SD[0] == 0.1


def test_the_nearest_bodies_exist_and_none_is_nearer() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(70, 70))
    hessian = root @ root.T + np.eye(70)
    wanted = LINKS.copy()
    wanted[:, 4:] *= rng.uniform(-0.5, 1.0, size=(7, 6))  # inertias that no body has
    assert not consistent(wanted).all()
    found = nearest_bodies(wanted, hessian, LINKS)
    assert consistent(found).all()

    def far(x: np.ndarray) -> float:
        e = (x - wanted).ravel()
        return float(e @ hessian @ e)

    tried = 0
    for size in rng.uniform(1e-4, 0.3, 400):
        other = found + size * (LINKS - found) + 0.01 * size * rng.normal(size=(7, 10)) * LINKS
        if consistent(other).all():
            tried += 1
            assert far(other) >= far(found) - 1e-9
    assert tried > 50
