"""Dry friction that grows with load: the bristle stiffness does not change with the level."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda

CAUSE = cause_named("load_dependent_friction")
JOINT = 3
"""From 0."""
DISTANCE = 0.03
LEVEL, GROWTH = 1.0, 0.1
"""Friction without load [N·m], and what it grows by [-]."""


@pytest.fixture(scope="module")
def data() -> Data:
    return data_of(panda(), hidden(panda())).with_presliding(np.full(7, DISTANCE))


def bristle(data: Data, stiffness: float) -> np.ndarray:
    """Return (T,) torque of a bristle whose level is `LEVEL` plus `GROWTH` times the load."""
    level = LEVEL + GROWTH * data.recording.along_path(np.abs(data.rigid[:, JOINT]))
    out = np.zeros(len(level))
    out[0] = level[0] * data.direction(JOINT)[0]
    for k, step in enumerate(np.diff(data.reversal_path[:, JOINT])):
        end = np.sign(step) * level[k + 1]
        out[k + 1] = end + (out[k] - end) * np.exp(-stiffness * abs(step) / level[k + 1])
    return np.asarray(data.smooth(out))


def modelled(data: Data, shape: tuple[float, ...]) -> np.ndarray:
    """Return (T,) torque of the causes with the true levels."""
    plain = LEVEL * data.smooth(data.dry_friction_ratio(JOINT))
    return np.asarray(plain + GROWTH * CAUSE.columns(data, JOINT, shape)[:, 0])


def missing(model: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(model - true))))


def test_presliding_distances_without_load_grow_with_it(data: Data) -> None:
    """Known friction: the distance is that of the level without load."""
    true = bristle(data, LEVEL / DISTANCE)
    bent = CAUSE.resized((0.0, 0.0), np.array([GROWTH]), LEVEL)
    assert bent == (GROWTH / LEVEL, 0.0)
    left = missing(modelled(data, bent), true)
    assert left < 0.2 * missing(modelled(data, (0.0, 0.0)), true)
    assert left < 0.02 * GROWTH * np.abs(data.rigid[:, JOINT]).mean()
