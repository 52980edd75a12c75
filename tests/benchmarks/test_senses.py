"""The study of senses: what it says of signals whose noise, lag and steps are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy import senses as study


def test_the_white_part_is_found_under_motion():
    rng = np.random.default_rng(0)
    t = np.arange(20_000) * 1e-3
    t[5000:] += 0.004  # samples that are missing
    x = np.sin(2 * np.pi * 0.5 * t)[:, None] + np.array([1e-3, 3e-3]) * rng.normal(size=(20_000, 2))
    assert study.white_part(x, t) == pytest.approx([1e-3, 3e-3], rel=0.03)


@pytest.mark.parametrize("late", [0.005, 0.02])
def test_the_lag_of_a_speed_is_found(late):
    t = np.arange(20_000) * 1e-3
    waves = ((1.0, 0.5), (0.3, 2.1), (0.1, 5.3))
    q = sum(a * np.sin(w * t) for a, w in waves)
    dq = sum(a * w * np.cos(w * (t - late)) for a, w in waves)
    assert study.lag(q, dq, t) == pytest.approx(late, abs=0.5e-3)


def test_steps_are_found():
    x = np.rint(np.random.default_rng(0).normal(size=(1000, 1)) / 0.04) * 0.04
    assert study.resolution(x) == pytest.approx([0.04])


def test_senses_of_the_table_differ_as_their_names_say():
    own, noisy, late = (study.sensing_of("panda", name) for name in study.SENSES[1:])
    assert study.sensing_of("panda", "ideal").is_ideal
    assert noisy.of_joint("speed_noise", 7) == pytest.approx(3 * own.of_joint("speed_noise", 7))
    assert noisy.command_delay == own.command_delay
    assert late.command_delay == pytest.approx(own.command_delay + 0.005)
