"""Environments under a robot's senses."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control.sensing import Sensing
from stiction_envs.errors import StictionError
from tests.envs.helpers import batch_and_singles, mild

OFF = Sensing(angle_noise=1e-3, speed_noise=0.01, measurement_delay=0.002, missed_cycles=0.1)


def test_the_observation_is_what_was_read(kind):
    env = kind.make(sensing=OFF)
    env.reset(seed=3, options=kind.options)
    seen, *_ = env.step(mild(env, 6))
    core = env.unwrapped.core
    rig, names = core.rig, list(core.observation_names)
    origin = rig.start if hasattr(rig, "start") else rig.pose[0]
    unit = 1.0 if hasattr(rig, "start") else rig.protocol.threshold
    first = [k for k, name in enumerate(names) if name.startswith("displacement")]
    expected = (rig.senses.q[0] - origin) / unit
    assert seen[first] == pytest.approx(expected.astype(np.float32))
    assert np.abs(rig.senses.q[0] - rig.plant.position[0]).max() > 1e-4


def test_a_batch_is_its_single_environments_bit_for_bit(kind):
    spreads = {"senses": 0.5, "friction": 0.2}
    many = batch_and_singles(kind, 3, sensing=OFF, randomise=spreads)
    scale = many.unwrapped.core.rig.senses._scale
    assert len(set(scale.tolist())) == 3
    assert 0.5 <= scale.min() < scale.max() <= 1.5


def test_ideal_senses_have_no_spread(kind):
    with pytest.raises(StictionError, match="randomise senses: the senses are ideal"):
        kind.make(randomise={"senses": 0.5})
