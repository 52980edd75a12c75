"""Smooth torque over the angle: harmonics, in MuJoCo too, and what it is taken for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import Part, cause_named
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda

CAUSE = cause_named("position_dependent_torque")
COEFFICIENTS = (0.4, 1.0, -0.5, 0.2, 0.3)
PART = Part(cause=CAUSE.name, joint=4, shape=(2.0,), coefficients=COEFFICIENTS)


@pytest.fixture(scope="module")
def data() -> Data:
    return data_of(panda(), hidden(panda()))


def curve(q: np.ndarray) -> np.ndarray:
    c, a1, b1, a2, b2 = COEFFICIENTS
    return c + a1 * np.cos(q) + b1 * np.sin(q) + a2 * np.cos(2 * q) + b2 * np.sin(2 * q)


def test_beyond_the_angles_of_the_logs_it_is_constant(data: Data) -> None:
    """Law checked: a joint that goes on has the torque at the last known angle."""
    low, high = np.percentile(data.q[:, 3], [40, 60])
    part = replace(PART, shape=(2.0, float(low), float(high)))
    still = replace(data, recording=replace(data.recording, dt=float("nan")))  # no filter
    torque = CAUSE.columns(still, 3, part.shape) @ COEFFICIENTS
    q = data.q[:, 3]
    np.testing.assert_allclose(torque[q > high], curve(high))
    np.testing.assert_allclose(torque[q < low], curve(low))
    inside = (low < q) & (q < high)
    np.testing.assert_allclose(torque[inside], curve(q[inside]))


def test_harmonics_that_only_cancel_at_the_angles_of_the_logs_are_implausible(data: Data) -> None:
    """Law checked: the iiwa's joint 3 fits as well with 48 N·m that cancel; found on its log."""
    q = data.q.copy()
    q[:, 2] = np.linspace(-0.8, 0.8, len(q))
    sweep = replace(data, recording=replace(data.recording, q=q))
    cancelling = np.array([31.18, -47.822, -1.293, 20.511, 1.147, -3.69, -0.212])
    smaller = np.array([2.154, -3.128, -0.497, 1.16, 0.442])
    assert not CAUSE.possible(sweep, 2, cancelling, (3.0,), 0.0)
    assert CAUSE.possible(sweep, 2, smaller, (2.0,), 0.0)
