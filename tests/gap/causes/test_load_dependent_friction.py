"""Dry friction that grows with load: a bristle of unchanged stiffness, whatever its level."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.causes.friction.load_dependent_friction import MOST_RATIO
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
    level = LEVEL + GROWTH * np.abs(data.rigid[:, JOINT])
    out = np.zeros(len(data.t))
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


def test_measured_presliding_distances_are_of_the_mean_load(data: Data) -> None:
    ((_, mean),) = CAUSE.shapes(data, JOINT, data.residual[:, JOINT])
    assert mean == pytest.approx(np.abs(data.rigid[:, JOINT]).mean())
    true = bristle(data, (LEVEL + GROWTH * mean) / DISTANCE)
    bent = CAUSE.resized((0.0, mean), np.array([GROWTH]), LEVEL)
    assert bent == (GROWTH / (LEVEL + GROWTH * mean), mean)
    left = missing(modelled(data, bent), true)
    assert left < 0.2 * missing(
        modelled(data, CAUSE.resized((0.0, 0.0), np.array([GROWTH]), LEVEL)), true
    )
    assert left < 0.02 * GROWTH * mean


def test_a_model_file_without_the_bend_is_the_first_order(data: Data) -> None:
    first = data.smooth(data.growth(JOINT, np.abs(data.rigid[:, JOINT])))
    assert (CAUSE.columns(data, JOINT, ())[:, 0] == first).all()
    assert (CAUSE.columns(data, JOINT, (0.0, 0.0))[:, 0] == first).all()


def test_known_friction_has_no_mean_load(data: Data) -> None:
    known = dataclasses.replace(data, friction=dataclasses.replace(data.friction, in_nominal=True))
    assert CAUSE.shapes(known, JOINT, known.residual[:, JOINT]) == [(0.0, 0.0)]


def test_no_level_without_load_bends_no_further_than_the_limit() -> None:
    assert CAUSE.resized((0.0, 0.0), np.array([0.1]), 1e-6) == (MOST_RATIO, 0.0)
    assert CAUSE.resized((0.0, 0.0), np.array([0.1]), 0.0) == (0.0, 0.0)
