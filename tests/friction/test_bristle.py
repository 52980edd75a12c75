import numpy as np
import pytest

from stiction_envs.friction.bristle import bristle_after


def test_two_half_steps_are_one_step() -> None:
    whole = bristle_after(2e-4, -0.03, 0.4, 1e-3)
    half = bristle_after(bristle_after(2e-4, -0.03, 0.2, 5e-4), -0.03, 0.2, 5e-4)
    assert half == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("speed", [-0.5, 0.02])
def test_a_sliding_bristle_ends_at_the_level_of_friction_over_stiffness(speed: float) -> None:
    level, stiffness, step = 3.0, 2000.0, 1e-3
    z = 0.0
    for _ in range(2000):
        z = bristle_after(z, speed, abs(speed) * stiffness / level * step, step)
    assert z == pytest.approx(np.sign(speed) * level / stiffness, rel=1e-9)


def test_a_bristle_far_from_sliding_is_a_spring() -> None:
    assert bristle_after(0.0, 0.02, 1e-9, 1e-3) == pytest.approx(0.02 * 1e-3, rel=1e-8)
