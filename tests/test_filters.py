"""Filters and spectra are SciPy's."""

import numpy as np
import pytest
from scipy.signal import butter, csd, lfilter, sosfilt, sosfiltfilt, sosfreqz, welch

from stiction_envs.filters import butterworth, filter_sections, lagging, lowpass, spectrum

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("high", [False, True])
def test_the_gain_is_that_of_scipys_butterworth(order: int, high: bool) -> None:
    own = butterworth(order, 8.0, 1000.0, high=high)
    theirs = butter(order, 8.0, "highpass" if high else "lowpass", fs=1000.0, output="sos")
    at = np.geomspace(1e-3, 3.0, 200)
    assert sosfreqz(own, at)[1] == pytest.approx(sosfreqz(theirs, at)[1], rel=1e-7, abs=1e-12)


def test_blocks_are_filtered_as_scipy_filters_the_whole() -> None:
    sections = butter(4, 8.0, "highpass", fs=1000.0, output="sos")
    x = RNG.normal(size=(3, 2, 90)).cumsum(axis=-1)
    start = RNG.normal(size=(2, 3, 2, 2))
    expected, end = sosfilt(sections, x, axis=-1, zi=start)
    state, blocks = start.copy(), [np.ascontiguousarray(b) for b in np.split(x, 9, axis=-1)]
    for block in blocks:
        filter_sections(sections, block, state)
    np.testing.assert_array_equal(np.concatenate(blocks, axis=-1), expected)
    np.testing.assert_array_equal(state, end)


def test_the_lowpass_is_scipys_forwards_and_backwards() -> None:
    x = RNG.normal(size=(900, 3)).cumsum(axis=0)
    sos = butter(4, 20.0, fs=1000.0, output="sos")
    expected = sosfiltfilt(sos, x, axis=0, padtype="odd", padlen=150)
    assert lowpass(x, 1000.0, 20.0) == pytest.approx(expected, abs=1e-10)


def test_a_signal_that_rests_does_so_to_the_bit() -> None:
    x = np.full((500, 2), [0.3, -1.7])
    np.testing.assert_array_equal(lowpass(x, 200.0, 10.0), x)


def test_a_lag_is_scipys() -> None:
    x, keep = RNG.normal(size=(300, 2)).cumsum(axis=0), 0.9
    expected = lfilter([1 - keep], [1, -keep], x, axis=0, zi=keep * x[:1])[0]
    np.testing.assert_array_equal(lagging(x, keep), expected)


@pytest.mark.parametrize("length", [400, 401])
@pytest.mark.parametrize("rows", [300, 1000, 5001])
@pytest.mark.parametrize("median", [False, True])
def test_spectra_are_scipys(rows: int, length: int, median: bool) -> None:
    x = RNG.normal(size=(2, rows)).cumsum(axis=-1)
    most, average = min(length, rows), "median" if median else "mean"
    expected = welch(x, 100.0, nperseg=most, nfft=3 * most, average=average)
    for own, theirs in zip(
        spectrum(x, 100.0, length, padded=3, median=median), expected, strict=True
    ):
        assert own == pytest.approx(theirs, rel=1e-9)


def test_the_spectrum_across_two_signals_is_scipys() -> None:
    x, y = RNG.normal(size=(2, 3000)).cumsum(axis=-1)
    expected = csd(x, y, 100.0, nperseg=256)[1]
    got = spectrum(x, 100.0, 256, against=y)[1]
    assert got == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_the_filter_has_half_the_amplitude_at_its_cutoff_and_no_phase() -> None:
    t = np.arange(20_000) / 1000
    for hz, share in ((1.0, 1.0), (5.0, 0.996), (10.0, 0.5), (20.0, 0.004)):
        x = np.sin(2 * np.pi * hz * t)
        y = lowpass(x, 1000.0, 10.0)
        inner = slice(2000, -2000)
        both = np.stack([x, np.cos(2 * np.pi * hz * t)], axis=1)[inner]
        in_phase, out_of_phase = np.linalg.lstsq(both, y[inner], rcond=None)[0]
        assert in_phase == pytest.approx(share, abs=1e-3)
        assert abs(out_of_phase) < 1e-3


def test_above_half_the_rate_nothing_is_filtered() -> None:
    x = np.random.default_rng(0).normal(size=100)
    assert np.array_equal(lowpass(x, 10.0, 5.0), x)
