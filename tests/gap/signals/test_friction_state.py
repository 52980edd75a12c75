"""The noise floor of torques of known noise."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.filters import lowpass
from stiction_envs.gap.signals.prepare import prepare
from tests.gap.small_logs import RATE, hidden, panda


@pytest.mark.parametrize("cutoff", [3.0, 8.0, 20.0])
def test_the_floor_is_the_noise_that_the_filter_leaves(cutoff: float) -> None:
    log = hidden(panda(), lambda q, dq, ddq: 0.3 * dq, noise=0.05, seconds=20.0)
    data = assemble(panda(), prepare([log], cutoff_hz=cutoff))
    white = 0.05 * np.random.default_rng(0).normal(size=100_000)
    assert data.noise == pytest.approx(np.full(7, lowpass(white, RATE, cutoff).std()), rel=0.25)
