"""The compiled filter against scipy's, to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt_zi, sosfiltfilt

from stiction_envs.gap.signals.zero_phase import zero_phase


@pytest.mark.parametrize("shape", [(500,), (500, 1), (500, 7), (500, 7, 5)])
@pytest.mark.parametrize("pad", [0, 1, 60, 499])
def test_it_is_the_filter_of_scipy_to_the_bit(shape: tuple[int, ...], pad: int) -> None:
    x = np.random.default_rng(0).normal(size=shape).cumsum(axis=0)
    sections = butter(4, 5.0, fs=100.0, output="sos")
    found = zero_phase(x, sections, sosfilt_zi(sections), pad)
    np.testing.assert_array_equal(found, sosfiltfilt(sections, x, axis=0, padlen=pad))


def test_signals_in_any_order_of_memory_are_left_alone() -> None:
    x = np.asfortranarray(np.random.default_rng(1).normal(size=(200, 3)))
    before, sections = x.copy(), butter(4, 5.0, fs=100.0, output="sos")
    found = zero_phase(x, sections, sosfilt_zi(sections), 30)
    np.testing.assert_array_equal(x, before)
    np.testing.assert_array_equal(found, sosfiltfilt(sections, x, axis=0, padlen=30))
