"""Blocks of time that are held out together."""

import numpy as np
import pytest

from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden


@pytest.mark.parametrize(("seconds", "blocks"), [(2.5, 4), (8.0, 7), (30.0, 12)])
def test_guards_leave_most_of_a_short_log(seconds: float, blocks: int) -> None:
    """Each guard takes a quarter of a second; folds need four blocks."""
    arm = load_arm("panda")
    data = assemble(arm, prepare([hidden(arm, seconds=seconds)], cutoff_hz=10.0))
    assert data.blocks == blocks
    assert np.mean(data.block >= 0) > 0.6
