"""Dither waveforms, and their registry.

The sine is equation 2.21 of the thesis, d(t) = A sin(2πft); the other waveforms have the same
period 1/f, or sweep and mix frequencies around f. Every waveform has zero mean and |w| ≤ 1. Add
your own with a subclass of :class:`Waveform` and :func:`register_waveform`.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError, unknown

SWEEP_CYCLES = 64
"""Cycles of the centre frequency after which chirp and random repeat: their period is 64/f s
(`assumed`: long enough to keep 98 % of the chirp's power in its band; 0.8 s at 80 Hz)."""
TONES = 16  # Number of sines in the random waveform (`assumed`)
BANDWIDTH = 0.5
"""Relative bandwidth b of chirp and random, f(1 − b/2) … f(1 + b/2) [-] (`assumed`); at least
TONES / SWEEP_CYCLES, so that the random tones lie on different lines."""

GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # Step of SplitMix64
_TWO_PI = 2.0 * np.pi
# Edges of a square that fall on a sample (50 Hz at 1 kHz: every edge) would flip with the last bits
# of a summed-up time. Edges are therefore early by this part of a period [-] (assumed): more than
# those bits, and too little for any effect.
_EDGE = 1e-6
_CHECKED_SAMPLES = 4096  # of a new waveform's period [-] (assumed)


class Waveform(ABC):
    """A shape w(θ), θ = 2πft + φ: mean 0 over its period, |w| ≤ 1.

    An instance may have its own parameters (a duty cycle, say); each setting has its own name.
    """

    name: ClassVar[str]  # In amplitude tables and on the command line: letters, digits and ``_``
    cycles: ClassVar[int] = 1  # Period, in periods 1/f of the dither frequency
    sinusoidal: ClassVar[bool] = False  # Whether w(θ) = sin θ, which compiled code computes

    @abstractmethod
    def value(self, angle: Array, drawn: Array | None) -> Array:
        """Return w(θ) elementwise: an element's bits may not depend on its neighbours.

        Args:
            angle: θ, any shape [rad]; may be overwritten.
            drawn: (K, \\*angle.shape) result of :meth:`draw` for each element, or None.
        """

    def draw(self, seed: NDArray[np.uint64], joint: Index) -> Array:
        """Return (M, K) constants of M entries, once per dither; K = 0 unless overridden.

        ``seed`` (M,) is that of each entry's simulation, ``joint`` (M,) counts from 0.
        """
        return np.zeros((len(seed), 0))


_registry: dict[str, Waveform] = {}
WAVEFORMS: Mapping[str, Waveform] = MappingProxyType(_registry)
"""Waveforms by name; the position of a name is the code stored in `Dither.waveform`."""


def register_waveform(waveform: Waveform) -> None:
    """Register a waveform by its name, until the process ends.

    Raise a StictionError for a name that is taken or is not a word, and for a shape that is not
    finite, exceeds 1 or has a mean.
    """
    name = waveform.name
    if not re.fullmatch(r"\w+", name):
        raise StictionError(f"waveform name {name!r}: expected letters, digits and _")
    if name in _registry:
        raise StictionError(f"waveform name {name!r}: expected one not in {', '.join(_registry)}")
    x = (np.arange(_CHECKED_SAMPLES) + 0.5) / _CHECKED_SAMPLES * waveform.cycles
    drawn = waveform.draw(np.zeros(1, dtype=np.uint64), np.zeros(1, dtype=int))
    constants = np.repeat(drawn.T, len(x), axis=1) if drawn.size else None
    w = waveform.value(_TWO_PI * x, constants)
    if w.shape != x.shape or w.dtype != np.float64 or not np.isfinite(w).all():
        raise StictionError(f"waveform {name!r}: expected a finite float64 for every angle")
    if np.abs(w).max() > 1.0 + 1e-9 or abs(w.mean()) > 1e-3:
        raise StictionError(
            f"waveform {name!r}: peak {np.abs(w).max():.4g}, mean {w.mean():.4g}: "
            "expected a peak of at most 1 and a mean of 0"
        )
    _registry[name] = waveform


def named(name: str) -> Waveform:
    """Return the waveform of that name; raise a StictionError for an unknown one."""
    if name not in _registry:
        raise unknown("waveform", name, _registry)
    return _registry[name]


class Sine(Waveform):
    """sin θ (thesis, eq. 2.21)."""

    name = "sine"
    sinusoidal = True

    def value(self, angle: Array, drawn: Array | None) -> Array:
        """w = sin θ."""
        return np.sin(angle, out=angle)


class Square(Waveform):
    """+1 in the first half of the period, −1 in the second."""

    name = "square"

    def value(self, angle: Array, drawn: Array | None) -> Array:
        """w = ±1; an edge is 1e-6 of a period early."""
        x = _in_cycles(angle)
        x += _EDGE
        x -= np.floor(x)
        return np.where(x < 0.5, 1.0, -1.0)


class Triangle(Waveform):
    """0, +1, 0, −1 at the quarters of the period, straight between."""

    name = "triangle"

    def value(self, angle: Array, drawn: Array | None) -> Array:
        """w rises and falls by 4 per period."""
        x = _in_cycles(angle)
        x += 0.25
        x -= np.floor(x)
        x -= 0.5
        return np.asarray(1.0 - 4.0 * np.abs(x))


class Chirp(Waveform):
    """Frequency rising linearly from f(1 − b/2) to f(1 + b/2) and falling back in 64/f s."""

    name = "chirp"
    cycles = SWEEP_CYCLES

    def value(self, angle: Array, drawn: Array | None) -> Array:
        """w = sin of the swept angle."""
        # Odd about x = 0, hence zero mean; a whole number of turns, hence continuous.
        x = _in_cycles(angle)
        x -= SWEEP_CYCLES * np.rint(x / SWEEP_CYCLES)
        x *= (1.0 - 0.5 * BANDWIDTH) + (BANDWIDTH / SWEEP_CYCLES) * np.abs(x)
        x *= _TWO_PI
        return np.sin(x, out=x)


class RandomTones(Waveform):
    """16 sines of equal size in f(1 − b/2) … f(1 + b/2), phases from the seed and the joint.

    Period 64/f s, scaled so that the peak stays just below 1 (RMS about 0.25).
    """

    name = "random"
    cycles = SWEEP_CYCLES

    def value(self, angle: Array, drawn: Array | None) -> Array:
        """w = gain · Σ sin(line · θ/64 + phase)."""
        assert drawn is not None
        x = _in_cycles(angle)
        x -= SWEEP_CYCLES * np.rint(x / SWEEP_CYCLES)
        x *= _TWO_PI / SWEEP_CYCLES
        total, tone = np.zeros_like(x), np.empty_like(x)
        # Tone by tone: a sum over an axis would change its order of adding with the batch size.
        for line, start in zip(self._lines(), drawn[:-1], strict=True):
            np.multiply(x, line, out=tone)
            tone += start
            total += np.sin(tone, out=tone)
        total *= drawn[-1]
        return total

    def draw(self, seed: NDArray[np.uint64], joint: Index) -> Array:
        """Return (M, TONES + 1): the tones' phases [rad] and the gain that bounds their peak."""
        # tones depend on seed and joint, not on the batch
        key = mix(seed)[:, None] + mix(joint.astype(np.uint64))[:, None]
        bits = mix(np.add(key, np.arange(TONES, dtype=np.uint64))) >> np.uint64(11)
        phases = bits.astype(float) * (_TWO_PI * 2.0**-53)
        # |w| is at most its envelope, a trigonometric polynomial of degree d; sampled at G points
        # its maximum is at most the largest sample / cos(πd/G) (Ehlich and Zeller 1964).
        shift = (self._lines() - SWEEP_CYCLES).astype(int)
        degree = int(np.abs(shift).max())
        points = 32 * degree
        spectrum = np.zeros((len(seed), points), dtype=complex)
        spectrum[:, shift] = np.exp(1j * phases)
        peak = np.abs(np.fft.ifft(spectrum, axis=1, norm="forward")).max(axis=1)
        return np.column_stack([phases, np.cos(np.pi * degree / points) / peak])

    @staticmethod
    def _lines() -> Array:
        """Return frequencies of the tones in multiples of f/64: whole, different, in the band."""
        spread = (np.arange(TONES) + 0.5) / TONES - 0.5
        return np.rint(SWEEP_CYCLES * (1.0 + BANDWIDTH * spread))


def _in_cycles(angle: Array) -> Array:
    return np.multiply(angle, 1.0 / _TWO_PI, out=angle)


def mix(x: Any) -> Any:
    """Return SplitMix64 (Steele, Lea & Flood 2014) of a 64-bit integer, or of each of an array."""
    x = x + GOLDEN
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


DEFAULT_WAVEFORM = Sine.name  # Used where a table or a call names none

register_waveform(Sine())
register_waveform(Square())
register_waveform(Triangle())
register_waveform(Chirp())
register_waveform(RandomTones())
