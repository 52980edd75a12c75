"""Torque dither A·w(2πft + φ) on every joint of N simulations at once.

The sine is equation 2.21 of the thesis, d(t) = A sin(2πft); the other waveforms have the same
period 1/f, or sweep and mix frequencies around f. Every waveform has zero mean and |w| ≤ 1. Beside
them: what a held controller makes of a sine (:func:`alias`, :func:`check_frequency`).
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.dither.kernels import sine
from stiction_envs.errors import StictionError, unknown

WAVEFORMS = ("sine", "square", "triangle", "chirp", "random")
"""Names of the waveforms; their position is the code stored in :attr:`Dither.waveform`."""
CYCLES = 64
"""Cycles of the centre frequency after which chirp and random repeat: their period is 64/f s
(`assumed`: long enough to keep 98 % of the chirp's power in its band; 0.8 s at 80 Hz)."""
TONES = 16
"""Number of sines in the random waveform (`assumed`)."""

BANDWIDTH = 0.5
"""Default relative bandwidth b of chirp and random, f(1 − b/2) … f(1 + b/2) (`assumed`)."""

_SINE, _SQUARE, _TRIANGLE, _CHIRP, _RANDOM = range(len(WAVEFORMS))
_TWO_PI = 2.0 * np.pi
# Edges of a square that fall on a sample (50 Hz at 1 kHz: every edge) would flip with the last bits
# of a summed-up time; an edge is therefore moved 1e-6 of a period, above that and below any effect.
_EDGE = 1e-6

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False, init=False, repr=False)
class Dither:
    """Dither torque of N simulations × n joints, immutable.

    Torque = A·w(2πft + φ)·exp(−(q̇/v_gate)²) + offset. All (N, n) arguments but ``amplitude`` may
    have any shape that broadcasts to its shape. A row's torque is bit for bit the same in whatever
    batch it is computed.

    ======== ===================================================================================
    sine     sin(θ), θ = 2πft + φ (thesis, eq. 2.21)
    square   +1 in the first half of the period, −1 in the second
    triangle 0, +1, 0, −1 at the quarters of the period, straight between
    chirp    frequency rising linearly from f(1 − b/2) to f(1 + b/2) and falling back in 64/f s
    random   16 sines of equal size in f(1 − b/2) … f(1 + b/2), phases from the seed and the joint,
             period 64/f s, scaled so that the peak stays just below 1 (RMS about 0.25)
    ======== ===================================================================================

    The mean of the square's samples is zero where a period holds an even number of them; the other
    waveforms' wherever the sampling theorem holds.
    """

    amplitude: Floats
    """A, (N, n) N·m, ≥ 0; exactly 0 leaves exactly the offset."""
    frequency: Floats
    """f, (N, n) Hz, > 0 wherever the amplitude is."""
    phase: Floats
    """φ, (N, n) rad; for chirp and random a shift along the 64 cycles. Default 0."""
    offset: Floats
    """Constant torque, (N, n) N·m, never gated. Default 0."""
    waveform: NDArray[np.int8]
    """(N, n) positions in :data:`WAVEFORMS`; given as a name, an array of names or of codes."""
    gate_velocity: Floats
    """v_gate, (N, n) rad/s, > 0; ∞ (the default) never gates. Amplitude as a function of velocity
    is future work in section 6.1 of the thesis. q̇ includes the motion the dither itself causes."""
    seed: NDArray[np.uint64]
    """(N,), ≥ 0: draws the random waveform; one integer gives every simulation the same one."""
    bandwidth: float
    """b, relative bandwidth of chirp and random, 0.25 … 1.9 (`assumed` default 0.5)."""

    _tones: Floats = field(init=False)  # (N, n, TONES + 1): phases in rad, gain; 0 if not random
    _branches: tuple[tuple[Any, ...], ...] = field(init=False)
    _gate: Floats | None = field(init=False)
    sines: tuple[Floats, Floats, Floats] | None = field(init=False)
    """ω [rad/s], φ [rad] and A [N·m], (N, n), where there is nothing else but sines."""
    _constant: Floats | None = field(init=False)

    def __init__(
        self,
        *,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        phase: ArrayLike = 0.0,
        offset: ArrayLike = 0.0,
        waveform: ArrayLike = "sine",
        gate_velocity: ArrayLike = np.inf,
        seed: ArrayLike = 0,
        bandwidth: float = BANDWIDTH,
    ) -> None:
        a = _numbers("amplitude", amplitude, None)
        f = _numbers("frequency", frequency, a.shape)
        _check_drive(a, f)
        gate = _numbers("gate_velocity", gate_velocity, a.shape, finite=False)
        _check("gate_velocity", gate, ~(gate > 0), "> 0 rad/s (inf: no gating)")
        # b·CYCLES ≥ TONES keeps the random tones on different lines; b < 2 keeps them off 0 Hz.
        low = TONES / CYCLES
        if not low <= bandwidth <= 1.9:
            raise StictionError(f"dither bandwidth is {bandwidth}: allowed are {low} to 1.9")
        self._fill(
            amplitude=a,
            frequency=f,
            phase=_numbers("phase", phase, a.shape),
            offset=_numbers("offset", offset, a.shape),
            waveform=_codes(waveform, a.shape),
            gate_velocity=gate,
            seed=_seeds(seed, a.shape[0]),
            bandwidth=float(bandwidth),
        )
        self._fill(_tones=self._draw_tones())
        self._prepare()

    @classmethod
    def none(cls, N: int, n: int) -> Dither:
        """No dither at all: zero torque on N simulations × n joints."""
        return cls(amplitude=np.zeros((N, n)), frequency=0.0)

    @classmethod
    def from_table(cls, rows: Iterable[Any], N: int, n: int, **options: Any) -> Dither:
        """The same amplitude table on N simulations: one row per dithered joint.

        A row has ``joint`` (from 1), ``frequency_hz``, ``amplitude_nm``, ``waveform`` and
        ``offset_nm``, as :class:`stiction_envs.measured.AmplitudeRow` has. ``options``: ``phase``,
        ``gate_velocity``, ``seed``, ``bandwidth`` as for the class itself.
        """
        a, f, c = np.zeros((3, n))
        names = np.full(n, WAVEFORMS[_SINE], dtype=object)
        free = list(range(1, n + 1))
        for row in rows:
            if row.joint not in free:
                raise unknown("or repeated joint of an amplitude table", row.joint, free)
            free.remove(row.joint)
            j = row.joint - 1
            a[j], f[j] = row.amplitude_nm, row.frequency_hz
            c[j], names[j] = row.offset_nm, row.waveform
        a = np.tile(a, (N, 1))
        return cls(amplitude=a, frequency=f, offset=c, waveform=names, **options)

    @property
    def N(self) -> int:
        """Number of simulations."""
        return self.amplitude.shape[0]

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.amplitude.shape[1]

    @property
    def gated(self) -> bool:
        """Whether :meth:`torque` needs velocities."""
        return self._gate is not None

    def __repr__(self) -> str:
        names = [WAVEFORMS[b[0]] for b in self._branches]
        return f"Dither(N={self.N}, n={self.n}, {'+'.join(names) or 'none'})"

    def torque(self, t: float | Floats, qd: Floats | None = None) -> Floats:
        """Dither torque, fresh (N, n) array in N·m.

        Args:
            t: time, s: one number, or (N,) when the simulations' clocks differ.
            qd: joint velocities, (N, n) rad/s; needed only when a gate velocity is set.
        """
        shape = self.amplitude.shape
        if self.sines is not None and isinstance(t, np.ndarray) and t.shape == shape[:1]:
            plain = np.empty(shape)  # as in every control cycle
            sine(*self.sines, t, plain)
            return plain
        own = isinstance(t, np.ndarray) and t.ndim == 1
        out: Floats | None = None
        for code, where, rows, omega, phase, amplitude, tones in self._branches:
            now = t if not own else t[:, None] if where is None else t[rows]  # type: ignore[index]
            w = omega * now
            w += phase
            w = np.sin(w, out=w) if code == _SINE else self._shape(code, w, tones)
            w *= amplitude
            if where is not None:
                out = np.zeros(shape) if out is None else out
                out.reshape(-1)[where] = w
            else:
                out = w
        out = np.zeros(shape) if out is None else out
        if self._gate is not None:
            if qd is None or qd.shape != shape:
                got = None if qd is None else qd.shape
                raise StictionError(f"gated dither: qd has shape {got}: allowed is {shape}")
            g = np.multiply(qd, self._gate, out=np.empty(shape))
            out *= np.exp(np.negative(np.square(g, out=g), out=g), out=g)
        if self._constant is not None:
            out += self._constant
        return out

    def retune(
        self,
        t: float | Floats,
        *,
        amplitude: ArrayLike | None = None,
        frequency: ArrayLike | None = None,
    ) -> Dither:
        """New amplitudes [N·m] and/or frequencies [Hz] from time ``t`` on, without a jump in phase.

        φ becomes φ + 2π(f_old − f_new)·t, so that 2πft + φ is the same before and after at ``t``
        (s; one number or (N,)). Entries whose frequency stays keep their phase bit for bit.
        """
        shape = self.amplitude.shape
        a = self.amplitude if amplitude is None else _numbers("amplitude", amplitude, shape)
        f = self.frequency if frequency is None else _numbers("frequency", frequency, shape)
        _check_drive(a, f)
        fields: dict[str, Any] = {"amplitude": a, "frequency": f}
        if frequency is not None:
            now = np.asarray(t, dtype=float)
            if now.ndim > 1 or (now.ndim == 1 and now.shape[0] != self.N):
                raise StictionError(f"retune t has shape {now.shape}: allowed is () or ({self.N},)")
            _check("retune time t", now, ~np.isfinite(now), "finite, s")
            jump = _TWO_PI * (self.frequency - f)
            fields["phase"] = self.phase + jump * (now[:, None] if now.ndim else now)
        return self._derive(fields)

    def take(self, ids: ArrayLike) -> Dither:
        """The dither of simulations ``ids`` (positions or a mask), in that order."""
        ids = _positions(ids)
        return self._derive({name: getattr(self, name)[ids] for name in _ROWS})

    def set_rows(self, ids: ArrayLike, other: Dither) -> Dither:
        """This dither with the rows of simulations ``ids`` (positions or a mask) from ``other``."""
        ids = _positions(ids)
        mine, theirs = (ids.size, self.n, self.bandwidth), (other.N, other.n, other.bandwidth)
        if mine != theirs:
            raise StictionError(f"set_rows (N, n, bandwidth) is {theirs}: allowed is {mine}")
        fields = {name: getattr(self, name).copy() for name in _ROWS}
        for name, values in fields.items():
            values[ids] = getattr(other, name)
        return self._derive(fields)

    def _fill(self, **fields: Any) -> None:
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def _derive(self, fields: dict[str, Any]) -> Dither:
        """A copy with some fields replaced by already checked ones."""
        new = copy.copy(self)
        new._fill(**fields)
        new._prepare()
        return new

    def _prepare(self) -> None:
        """Sort the entries by waveform once, so that :meth:`torque` only does arithmetic."""
        driven = self.amplitude > 0
        omega = _TWO_PI * self.frequency
        # + 0.0 makes a phase of −0.0 a 0.0, so that no path below leaves a torque of −0.0.
        phase = self.phase + 0.0
        branches = []
        for code in np.unique(self.waveform[driven]).tolist():
            mask = driven & (self.waveform == code)
            where = None if mask.all() else np.flatnonzero(mask)
            rows = None if where is None else where // self.n
            pick: Any = ... if where is None else mask
            tones: Any = np.moveaxis(self._tones, -1, 0)
            tones = np.ascontiguousarray(tones[:, pick]) if code == _RANDOM else None
            branches.append(
                (code, where, rows, omega[pick], phase[pick], self.amplitude[pick], tones)
            )
        gated = bool(np.isfinite(self.gate_velocity).any())
        shifted = bool(self.offset.any())
        plain = not (gated or shifted) and all(b[0] == _SINE for b in branches)
        self._fill(
            _branches=tuple(branches),
            sines=(omega, phase, self.amplitude) if plain else None,
            _gate=1.0 / self.gate_velocity if gated else None,
            # A closed gate may leave −0.0, which adding the (then zero) offset turns into 0.0.
            _constant=self.offset + 0.0 if shifted or gated else None,
        )

    def _shape(self, code: int, angle: Floats, tones: Any) -> Floats:
        """w(θ) of every waveform but the sine; ``angle`` θ in rad is overwritten."""
        x = np.multiply(angle, 1.0 / _TWO_PI, out=angle)  # cycles
        if code == _SQUARE:
            x += _EDGE
            x -= np.floor(x)
            return np.where(x < 0.5, 1.0, -1.0)
        if code == _TRIANGLE:
            x += 0.25
            x -= np.floor(x)
            x -= 0.5
            return 1.0 - 4.0 * np.abs(x)
        if code == _CHIRP:
            # Odd about x = 0, hence zero mean; a whole number of turns, hence continuous.
            x -= CYCLES * np.rint(x / CYCLES)
            x *= (1.0 - 0.5 * self.bandwidth) + (self.bandwidth / CYCLES) * np.abs(x)
            x *= _TWO_PI
            return np.sin(x, out=x)
        x -= CYCLES * np.rint(x / CYCLES)
        x *= _TWO_PI / CYCLES
        total, tone = np.zeros_like(x), np.empty_like(x)
        # Tone by tone: a sum over an axis would change its order of adding with the batch size.
        for line, start in zip(_lines(self.bandwidth), tones[:-1], strict=True):
            np.multiply(x, line, out=tone)
            tone += start
            total += np.sin(tone, out=tone)
        total *= tones[-1]
        return total

    def _draw_tones(self) -> Floats:
        """Phases of the random entries' tones and the gain that bounds their peak."""
        tones = np.zeros((self.N, self.n, TONES + 1))
        row, joint = np.nonzero(self.waveform == _RANDOM)
        if row.size == 0:
            return tones
        key = _mix(self.seed[row])[:, None] + _mix(joint.astype(np.uint64))[:, None]
        bits = _mix(key + np.arange(TONES, dtype=np.uint64)) >> np.uint64(11)
        phases = bits.astype(float) * (_TWO_PI * 2.0**-53)
        # |w| is at most its envelope, a trigonometric polynomial of degree d; sampled at G points
        # its maximum is at most the largest sample / cos(πd/G) (Ehlich and Zeller 1964).
        shift = (_lines(self.bandwidth) - CYCLES).astype(int)
        degree = int(np.abs(shift).max())
        points = 32 * degree
        spectrum = np.zeros((row.size, points), dtype=complex)
        spectrum[:, shift] = np.exp(1j * phases)
        peak = np.abs(np.fft.ifft(spectrum, axis=1, norm="forward")).max(axis=1)
        tones[row, joint, :TONES] = phases
        tones[row, joint, TONES] = np.cos(np.pi * degree / points) / peak
        return tones


_ROWS = ("amplitude", "frequency", "phase", "offset", "waveform", "gate_velocity", "seed", "_tones")


def _positions(ids: ArrayLike) -> NDArray[np.intp]:
    ids = np.atleast_1d(np.asarray(ids))
    return np.flatnonzero(ids) if ids.dtype == bool else ids.astype(np.intp)


def _lines(bandwidth: float) -> Floats:
    """Frequencies of the random tones in multiples of f/CYCLES: whole, different, in the band."""
    spread = (np.arange(TONES) + 0.5) / TONES - 0.5
    return np.rint(CYCLES * (1.0 + bandwidth * spread))


def _mix(x: NDArray[Any]) -> NDArray[np.uint64]:
    """Hash of 64-bit integers (splitmix64): tones depend on seed and joint, not on the batch."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _numbers(name: str, value: ArrayLike, shape: Any, *, finite: bool = True) -> Floats:
    """Own float array of ``value``, broadcast to ``shape`` (None: must be two-dimensional)."""
    try:
        array = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError):
        raise StictionError(
            f"dither {name} is a {type(value).__name__}: allowed are numbers"
        ) from None
    if shape is None and array.ndim != 2:
        raise StictionError(f"dither {name} has shape {array.shape}: allowed is (N, n)")
    array = _broadcast(name, array, shape or array.shape)
    if finite:
        _check(name, array, ~np.isfinite(array), "finite")
    return array


def _broadcast(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Own C-ordered copy of ``array`` in ``shape``."""
    try:
        return np.broadcast_to(array, shape).copy(order="C")
    except ValueError:
        raise StictionError(f"dither {name} has shape {array.shape}: allowed is {shape}") from None


def _check(name: str, values: NDArray[Any], bad: NDArray[np.bool_], allowed: str) -> None:
    """Raise, naming the first bad entry of (N, n) values by simulation from 0 and joint from 1."""
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        where = "".join(
            (" of simulation {}", ", joint {}")[k].format(i + k) for k, i in enumerate(at)
        )
        raise StictionError(f"dither {name}{where} is {values[at]}: allowed is {allowed}")


def _check_drive(amplitude: Floats, frequency: Floats) -> None:
    _check("amplitude", amplitude, amplitude < 0, ">= 0 N·m")
    bad = (frequency < 0) | ((frequency == 0) & (amplitude > 0))
    _check("frequency", frequency, bad, "> 0 Hz where the amplitude is")


def _codes(waveform: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.int8]:
    array = np.asarray(waveform)
    if array.dtype.kind in "iu":
        for code in np.setdiff1d(array, range(len(WAVEFORMS))):
            raise unknown("waveform code", int(code), range(len(WAVEFORMS)))
        codes = array.astype(np.int8)
    else:
        for name in np.unique(array.astype(str)):
            if name not in WAVEFORMS:
                raise unknown("waveform", str(name), WAVEFORMS)
        codes = np.zeros(array.shape, dtype=np.int8)
        for code, name in enumerate(WAVEFORMS):
            codes[array == name] = code
    return _broadcast("waveform", codes, shape)


def _seeds(seed: ArrayLike, N: int) -> NDArray[np.uint64]:
    array = np.asarray(seed)
    if array.dtype.kind not in "iu" or (array.size and array.min() < 0):
        got = array.min() if array.dtype.kind == "i" else array.dtype
        raise StictionError(f"dither seed is {got}: allowed are integers from 0 to 2^64 - 1")
    return _broadcast("seed", array.astype(np.uint64), (N,))


def alias(frequency_hz: float, rate_hz: float) -> float:
    """Frequency [Hz] at which a controller that holds its command at ``rate_hz`` shows a sine.

    0 means that every sample is the same: a constant torque A·sin φ. At half the rate the samples
    are ±A·sin φ. Harmonics of the other waveforms alias by the same rule.
    """
    for what, value in (("frequency", frequency_hz), ("controller rate", rate_hz)):
        if not (np.isfinite(value) and value > 0):
            raise StictionError(f"{what} {value} Hz: allowed is > 0")
    return float(abs(frequency_hz - rate_hz * np.rint(frequency_hz / rate_hz)))


def check_frequency(frequency_hz: float, rate_hz: float) -> str | None:
    """Warning when a controller of ``rate_hz`` [Hz] cannot show a sine of ``frequency_hz`` [Hz].

    None below half the rate, one line from there up to the rate itself (the thesis commanded 100
    and 200 Hz on the iiwa, whose driver runs at 200 Hz by default), an error above it.
    """
    shown = alias(frequency_hz, rate_hz)
    f, r = f"{frequency_hz:g} Hz", f"{rate_hz:g} Hz"
    if frequency_hz > rate_hz:
        raise StictionError(f"dither frequency {f} at a {r} controller: allowed is at most {r}")
    if 2 * frequency_hz < rate_hz:
        return None
    if 2 * frequency_hz == rate_hz:
        return f"dither of {f} at a {r} controller sits at Nyquist: samples are ±A·sin φ"
    if shown == 0:
        return f"dither of {f} at a {r} controller aliases to a constant offset A·sin φ"
    return f"dither of {f} at a {r} controller aliases to {shown:g} Hz"
