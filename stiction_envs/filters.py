"""Filters and spectra of even samples, as SciPy computes them, without `scipy.signal`.

`scipy.signal` takes longer to load than an environment takes to make: a twentieth of the time of a
diagnosis of one minute (measured).
"""

from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled

ORDER = 4
"""Order of the Butterworth low-pass [-]; assumed. It runs twice, so that half the amplitude is left
at the cutoff."""


def butterworth(order: int, cutoff_hz: float, rate_hz: float, *, high: bool = False) -> Array:
    """Return a Butterworth filter of even order as sections (order/2, 6) b0, b1, b2, 1, a1, a2.

    The analog poles are moved to the warped cutoff, where the gain is 1/√2, and go through the
    bilinear transform, whose rate is set to 2. Each section has gain 1 where the filter passes all.
    """
    warped = 4.0 * np.tan(np.pi * (2.0 * cutoff_hz / rate_hz) / 2.0)
    prototype = -np.exp(1j * np.pi * np.arange(1 - order, 0, 2) / (2 * order))
    poles = warped / prototype if high else warped * prototype
    digital = (4.0 + poles) / (4.0 - poles)
    a1, a2, side = -2.0 * digital.real, np.square(np.abs(digital)), -1.0 if high else 1.0
    b = (1.0 + side * a1 + a2) / 4.0
    return np.stack([b, 2.0 * side * b, b, np.ones_like(b), a1, a2], axis=1)


@compiled
def filter_sections(sections: Array, x: Array, state: Array) -> None:
    """Filter x (..., K), C-contiguous, along its last axis, in place; the states run on.

    Sections (S, 6) are those of `butterworth`; ``state`` (S, ..., 2), changed, is zeros for a
    signal that was zero for long.
    """
    rows = x.reshape(-1, x.shape[-1])
    z = state.reshape(len(sections), -1, 2)
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            value = rows[i, k]
            for s in range(len(sections)):
                b0, b1, b2, _, a1, a2 = sections[s]
                new = b0 * value + z[s, i, 0]
                z[s, i, 0] = b1 * value - a1 * new + z[s, i, 1]
                z[s, i, 1] = b2 * value - a2 * new
                value = new
            rows[i, k] = value


def lowpass(x: ArrayLike, rate_hz: float, cutoff_hz: float) -> Array:
    """Return the filter of all signals: Butterworth of order `ORDER`, forwards and backwards.

    Nonlinear functions of the signals must pass it too before a comparison.

    Args:
        x: even samples along the first axis.
        rate_hz: sampling rate, Hz.
        cutoff_hz: frequency at which half the amplitude is left, Hz; unchanged from half the
            sampling rate upwards.
    """
    x = np.asarray(x, np.float64)
    if 2 * cutoff_hz >= rate_hz or len(x) < 2:
        return x.copy()
    pad = min(len(x) - 1, int(np.ceil(3 * rate_hz / cutoff_hz)))
    columns = np.array(x.reshape(len(x), -1), order="C")
    start = columns[0].copy()
    columns -= start  # so that a signal that rests does so to the bit
    filtered = _both_ways(columns, _lowpass_sections(rate_hz, cutoff_hz), pad) + start
    return np.asarray(filtered.reshape(x.shape))


@lru_cache
def _lowpass_sections(rate_hz: float, cutoff_hz: float) -> Array:
    return butterworth(ORDER, cutoff_hz, rate_hz)


@compiled
def _both_ways(x: Array, sos: Array, pad: int) -> Array:
    """Return (K, k) filtered forwards, then backwards.

    Both ends are continued by ``pad`` samples of the signal turned about its end. scipy's
    `sosfiltfilt` does the same, but takes longer to begin than to filter a short segment.
    """
    rows, columns = x.shape
    y = np.empty((rows + 2 * pad, columns))
    y[pad : pad + rows] = x
    for i in range(pad):
        y[i] = 2 * x[0] - x[pad - i]
        y[rows + pad + i] = 2 * x[rows - 1] - x[rows - 2 - i]
    u, v = np.empty((2, len(sos), columns))
    for _ in range(2):
        for s in range(len(sos)):  # as if the signal had been at its first value for long
            u[s], v[s] = (1 - sos[s, 0]) * y[0], (sos[s, 2] - sos[s, 5]) * y[0]
        for i in range(len(y)):
            for s in range(len(sos)):  # a section works on a row while the next waits for it
                b0, b1, b2, _a0, a1, a2 = sos[s]
                for c in range(columns):
                    x_in = y[i, c]
                    out = b0 * x_in + u[s, c]
                    u[s, c] = b1 * x_in - a1 * out + v[s, c]
                    v[s, c] = b2 * x_in - a2 * out
                    y[i, c] = out
        y = y[::-1].copy()
    return y[pad : pad + rows]


@compiled
def lagging(x: Array, keep: float) -> Array:
    """Return (K, n) behind a low-pass of first order that begins at rest.

    Args:
        x: even samples (K, n).
        keep: what a step leaves of a difference: exp(-step / time constant) [-].
    """
    out = x.copy()
    for i in range(1, len(x)):
        for c in range(x.shape[1]):
            out[i, c] = (1 - keep) * x[i, c] + keep * out[i - 1, c]
    return out


def spectrum(
    x: Array,
    rate_hz: float,
    length: int,
    *,
    against: Array | None = None,
    padded: int = 1,
    median: bool = False,
) -> tuple[Array, Array]:
    """Return frequencies (f,) [Hz] and the one-sided spectral density (..., f) of even samples.

    P. Welch, "The use of fast Fourier transform for the estimation of power spectra", 1967: Hann
    windows that overlap by half, each less its mean.

    Args:
        x: even samples (..., K).
        rate_hz: their rate [Hz].
        length: samples of a window, even; K where there are fewer.
        against: (..., K) of another signal, for the density across both; None for that of ``x``.
        padded: length of each transform over that of the window [-].
        median: take the median over windows in place of the mean, without its bias
            (B. Allen et al., "FINDCHIRP", 2012, appendix B). It ignores the few that hold a jump.
    """
    length = min(length, x.shape[-1])
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)

    def transformed(signal: Array) -> Array:
        each = sliding_window_view(signal, length, axis=-1)[..., :: length - length // 2, :]
        each = (each - each.mean(axis=-1, keepdims=True)) * window
        return np.asarray(np.fft.rfft(each, padded * length))

    one = transformed(x)
    power = np.conj(one) * (one if against is None else transformed(against))
    power /= rate_hz * np.square(window).sum()
    power[..., 1 : -1 if padded * length % 2 == 0 else None] *= 2
    if against is None:
        power = power.real
    count = power.shape[-2]
    if median:
        bias = 1 + float(np.sum([1 / (k + 1) - 1 / k for k in range(2, count, 2)]))
        density = np.median(power, axis=-2) / bias
    else:
        density = power.mean(axis=-2)
    return np.asarray(np.fft.rfftfreq(padded * length, 1 / rate_hz)), density
