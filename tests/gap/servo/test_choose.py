"""Which causes a joint needs: limits that were reached, and errors of slow and fast motion."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.servo.choose import Chooser, Question
from stiction_envs.gap.servo.fit import Fit
from stiction_envs.gap.servo.joint import speeds
from stiction_envs.gap.servo.parameters import FAR, INDEX, LOW
from stiction_envs.gap.settings import gap_settings
from tests.gap.servo.small_arm import motion, parameters

NOISE = 4e-4
BLOCK = 200
"""Rows of a block of 2 s."""


def _chooser(q: np.ndarray) -> Chooser:
    return Chooser(
        Question(
            motion=motion(q),
            nominal=parameters(),
            always=(),
            candidates=("coulomb_friction", "speed_limit"),
            low=LOW,
            counts=np.ones(len(q), dtype=bool),
            noise=NOISE,
            judged=True,
            settings=gap_settings().servo,
        )
    )


def _fit(error: np.ndarray, **values: float) -> Fit:
    return Fit(parameters=parameters(**values), free=(), angle=error, error=error)


def test_speeds_are_those_over_a_while_and_none_where_a_segment_begins() -> None:
    t = 0.01 * np.arange(400)
    ramp = motion(np.where(t < 2.0, 0.5 * t, 1.0))
    v = speeds(ramp, 0.1)
    assert (v[:10] == 0.0).all()
    np.testing.assert_allclose(v[10:200], 0.5)
    np.testing.assert_allclose(v[215:], 0.0)


def test_a_speed_limit_counts_where_the_joint_was_as_fast_again_and_again() -> None:
    t = 0.01 * np.arange(2000)
    chooser = _chooser(0.5 * np.abs((t % 4.0) - 2.0))  # 0.5 rad/s, to and fro
    none = np.zeros(len(t))
    assert chooser._reached(_fit(none, speed_limit=0.5))
    assert not chooser._reached(_fit(none, speed_limit=0.6))
    assert chooser._reached(_fit(none, speed_limit=FAR))
    once = _chooser(0.5 * np.minimum(t, 1.0))
    assert not once._reached(_fit(none, speed_limit=0.5))


def test_friction_of_slow_motion_counts_beside_large_errors_of_fast_motion() -> None:
    """Its squares are lost in the scatter of the fast blocks', its shares are not."""
    rng = np.random.default_rng(0)
    blocks = 20
    chooser = _chooser(np.zeros(BLOCK * blocks))
    size = np.where(np.arange(blocks) < 14, 1e-3, 2e-2)  # without friction in the model ×3 slowly
    more = np.where(np.arange(blocks) < 14, 3.0, rng.normal(1.02, 0.1, blocks))
    signs = rng.choice([-1.0, 1.0], size=BLOCK * blocks)
    best = _fit(np.repeat(size, BLOCK) * signs)
    less = _fit(np.repeat(size * more, BLOCK) * signs)
    worse = (less.error**2 - best.error**2).reshape(blocks, BLOCK).sum(axis=1)
    assert worse.mean() < 3.0 * worse.std(ddof=1) / np.sqrt(blocks)
    assert chooser._needed(best, less)


@pytest.mark.parametrize("seed", range(5))
def test_chance_and_what_is_below_the_noise_need_no_cause(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chooser = _chooser(np.zeros(BLOCK * 20))
    best = _fit(2e-3 * rng.normal(size=BLOCK * 20))
    assert not chooser._needed(best, _fit(2e-3 * rng.normal(size=BLOCK * 20)))
    assert not chooser._needed(best, _fit(best.error * 1.015))  # less than 2 %


def test_parameters_of_the_test_are_those_of_the_chooser() -> None:
    assert gap_settings().servo.selection.block_seconds == BLOCK * 0.01
    assert LOW[INDEX["speed_limit"]] < 0.5
