"""Data never change: with another field there are other arrays, and none of the old ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, cause_named
from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from tests.gap.small_logs import data_of, hidden, panda


@pytest.fixture(scope="module")
def data() -> Data:
    made = data_of(panda(), hidden(panda(), seconds=6.0))
    # worked out before anything is changed
    for cause in CAUSES:
        cause.columns(made, 1, cause.shapes(made, 1, made.rigid[:, 1])[0])
    return made


def test_what_is_worked_out_follows_a_changed_recording(data: Data) -> None:
    """Torques, costly columns of causes, directions: all are those of the new angles."""
    recording = data.recording
    q = recording.q[::-1].copy()
    back = replace(recording, q=q, reversal_path=recording.reversal_path[::-1].copy())
    other = replace(data, recording=back)
    model, dq, ddq = recording.pinocchio, recording.dq, recording.ddq
    np.testing.assert_array_equal(back.rigid, inverse_dynamics(model, q, dq, ddq))
    np.testing.assert_array_equal(other.recording.gravity, gravity_torque(model, q))
    for name in ("payload", "base_tilt", "coulomb_friction", "stribeck_friction", "backlash"):
        cause = cause_named(name)
        shape = cause.shapes(data, 1, data.rigid[:, 1])[0]
        before, after = (cause.columns(x, 1, shape) for x in (data, other))
        assert np.abs(after - before).max() > 1e-3, name


def test_directions_follow_the_presliding_distance(data: Data) -> None:
    soft = data.with_presliding(np.full(7, 0.02))
    assert np.abs(soft.directions - data.directions).max() > 0.5
    path, weight = data.reversal_path, np.ones(len(data.t))
    expected = bristles(path, data.runs(), np.full((7, 1), 0.02))[..., 0]
    np.testing.assert_array_equal(soft.directions, expected)
    own = grown(path[:, 1], data.runs(), 0.02, expected[:, 1], weight)
    np.testing.assert_array_equal(soft.growth(1, weight), own)


@pytest.mark.parametrize("shape", [(90,), (90, 4)])
def test_rates_are_those_of_numpy_within_each_segment_to_the_bit(shape: tuple[int, ...]) -> None:
    x = np.random.default_rng(0).normal(size=shape)
    runs = [slice(0, 50), slice(50, 51), slice(51, 53), slice(53, 56), slice(56, 90)]
    found = rate(x, runs, 0.003)
    for run in runs:
        few = run.stop - run.start < 3
        expected = np.zeros_like(x[run]) if few else np.gradient(x[run], 0.003, axis=0)
        np.testing.assert_array_equal(found[run], expected)
