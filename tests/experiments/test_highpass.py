"""The high-pass is SciPy's, to the bit."""

import numpy as np
from scipy.signal import butter, sosfilt

from stiction_envs.experiments.highpass import filter_sections


def test_blocks_are_filtered_as_scipy_filters_the_whole():
    rng = np.random.default_rng(1)
    sections = butter(4, 8.0, "highpass", fs=1000.0, output="sos")
    x = rng.normal(size=(3, 2, 90)).cumsum(axis=-1)
    start = rng.normal(size=(2, 3, 2, 2))
    expected, end = sosfilt(sections, x, axis=-1, zi=start)
    state, blocks = start.copy(), [np.ascontiguousarray(b) for b in np.split(x, 9, axis=-1)]
    for block in blocks:
        filter_sections(sections, block, state)
    np.testing.assert_array_equal(np.concatenate(blocks, axis=-1), expected)
    np.testing.assert_array_equal(state, end)
