"""A recording's noise floor, and its blocks of time that are held out together."""

import numpy as np
import pytest

from stiction_envs.filters import lowpass
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from tests.gap.small_logs import RATE, hidden, panda


@pytest.mark.parametrize("cutoff", [3.0, 8.0, 20.0])
def test_the_floor_is_the_noise_that_the_filter_leaves(cutoff: float) -> None:
    log = hidden(panda(), lambda q, dq, ddq: 0.3 * dq, noise=0.05, seconds=20.0)
    data = assemble(panda(), prepare([log], cutoff_hz=cutoff))
    white = 0.05 * np.random.default_rng(0).normal(size=100_000)
    assert data.noise == pytest.approx(np.full(7, lowpass(white, RATE, cutoff).std()), rel=0.25)


@pytest.mark.parametrize(("seconds", "blocks"), [(2.5, 4), (8.0, 7), (30.0, 12)])
def test_guards_leave_most_of_a_short_log(seconds: float, blocks: int) -> None:
    """Each guard takes a quarter of a second; folds need four blocks."""
    data = assemble(panda(), prepare([hidden(panda(), seconds=seconds)], cutoff_hz=10.0))
    assert data.block.max() + 1 == blocks
    assert np.mean(data.block >= 0) > 0.6
