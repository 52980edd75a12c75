"""Torque dither A·w(2πft + φ) on every joint of N simulations at once."""

import copy
from dataclasses import dataclass, field
from types import EllipsisType
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM, WAVEFORMS, Waveform, named
from stiction_envs.errors import StictionError, checked_array

_TWO_PI = 2.0 * np.pi

_Places = NDArray[np.intp] | None
_Branch = tuple[Waveform, _Places, _Places, Array, Array, Array, Array | None]
_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True, kw_only=True, eq=False, init=False, repr=False)
class Dither:
    """Dither torque of N simulations × n joints, immutable.

    Torque = A·w(2πft + φ)·exp(−(q̇/v_gate)²) + offset. All (N, n) arguments but ``amplitude`` may
    have any shape that broadcasts to its shape. A row's torque does not depend on its batch, bit
    for bit. The waveforms w are in `dither.waveforms`.

    Sampled waveforms have zero mean where the sampling theorem holds; the square only with an even
    number of samples per period.
    """

    amplitude: Array
    """A, (N, n) N·m, ≥ 0; exactly 0 leaves exactly the offset."""
    frequency: Array
    """f, (N, n) Hz, > 0 wherever the amplitude is."""
    phase: Array
    """φ, (N, n) rad; for chirp and random a shift along the 64 cycles. Default 0."""
    offset: Array
    """Constant torque, (N, n) N·m, never gated. Default 0."""
    waveform: NDArray[np.int8]
    """(N, n) positions in `WAVEFORMS`; given as a name, or an array of names."""
    gate_velocity: Array
    """v_gate, (N, n) rad/s, > 0; ∞ (the default) never gates. q̇ includes the motion that the dither
    itself causes; amplitude as a function of velocity is future work in section 6.1 of the thesis.
    """
    seed: NDArray[np.uint64]
    """(N,), ≥ 0: of a waveform's random constants; one integer is for every simulation."""

    _drawn: dict[str, Array] = field(init=False)  # constants by waveform, (N, n, K)
    _branches: tuple[_Branch, ...] = field(init=False)
    _gate: Array | None = field(init=False)
    sines: tuple[Array, Array, Array] | None = field(init=False)
    """ω [rad/s], φ [rad] and A [N·m], (N, n), where the dither is ungated sines only."""
    _constant: Array | None = field(init=False)

    def __init__(
        self,
        *,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        phase: ArrayLike = 0.0,
        offset: ArrayLike = 0.0,
        waveform: ArrayLike = DEFAULT_WAVEFORM,
        gate_velocity: ArrayLike = np.inf,
        seed: ArrayLike = 0,
    ) -> None:
        a = checked_array(amplitude, "dither amplitude")
        if a.ndim != 2:
            raise StictionError(f"dither amplitude has shape {a.shape}: expected (N, n)")
        f = checked_array(frequency, "dither frequency", a.shape, fill=True)
        _check("amplitude", a, a < 0, ">= 0 N·m")
        _check("frequency", f, (f < 0) | ((f == 0) & (a > 0)), "> 0 Hz where the amplitude is")
        gate = checked_array(
            gate_velocity, "dither gate_velocity", a.shape, fill=True, finite=False
        )
        _check("gate_velocity", gate, ~(gate > 0), "> 0 rad/s (inf: no gating)")
        self._fill(
            amplitude=a,
            frequency=f,
            phase=checked_array(phase, "dither phase", a.shape, fill=True),
            offset=checked_array(offset, "dither offset", a.shape, fill=True),
            waveform=_codes(waveform, a.shape),
            gate_velocity=gate,
            seed=_seeds(seed, a.shape[0]),
        )
        self._fill(_drawn=self._draw())
        self._prepare()

    @classmethod
    def none(cls, N: int, n: int) -> "Dither":
        """Return no dither: zero torque on N simulations × n joints."""
        return cls(amplitude=np.zeros((N, n)), frequency=0.0)

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
        """True if :meth:`torque` needs velocities."""
        return self._gate is not None

    def __repr__(self) -> str:
        codes = np.unique(self.waveform[self.amplitude > 0])
        names = "+".join(list(WAVEFORMS)[code] for code in codes) or "none"
        return f"Dither(N={self.N}, n={self.n}, {names})"

    def torque(self, t: float | Array, qd: Array | None = None) -> Array:
        """Dither torque, fresh (N, n) array in N·m, at time ``t`` [s], one number or (N,).

        Joint velocities ``qd`` (N, n) [rad/s] are needed only when a gate velocity is set.
        """
        shape = self.amplitude.shape
        if self.sines is not None:
            plain, times = np.zeros((self.N, 1, self.n)), np.empty((self.N, 1))
            times[:, 0] = t
            add_sines(*self.sines, times, np.arange(self.N), plain)
            return plain[:, 0]
        out = self.ungated(t)
        if self._gate is not None:
            if qd is None or qd.shape != shape:
                got = None if qd is None else qd.shape
                raise StictionError(f"gated dither: qd has shape {got}: expected {shape}")
            share = np.multiply(qd, self._gate, out=np.empty(shape))
            out *= np.exp(-np.square(share))
        if self._constant is not None:
            out += self._constant
        return out

    def ungated(self, t: float | Array) -> Array:
        """Return `torque` without gates and offsets, of a dither that is not `sines`."""
        shape = self.amplitude.shape
        own = isinstance(t, np.ndarray) and t.ndim == 1
        out: Array | None = None
        for waveform, where, rows, omega, phase, amplitude, drawn in self._branches:
            now = t if not own else t[:, None] if where is None else t[rows]  # type: ignore[index]
            angle = omega * now
            angle += phase
            w = waveform.value(angle, drawn)
            w *= amplitude
            if where is not None:
                out = np.zeros(shape) if out is None else out
                out.reshape(-1)[where] = w
            else:
                out = w
        return np.zeros(shape) if out is None else out

    def retune(self, t: Array, *, amplitude: Array, frequency: Array) -> "Dither":
        """Return the dither with new A [N·m] and f [Hz], valid and (N, n), from times t (N,) [s].

        φ becomes φ + 2π(f_old − f_new)·t, so that 2πft + φ is the same before and after at ``t``.
        Entries whose frequency stays keep their phase bit for bit.
        """
        phase = self.phase + _TWO_PI * (self.frequency - frequency) * t[:, None]
        return self._derive(amplitude=amplitude.copy(), frequency=frequency.copy(), phase=phase)

    def set_rows(self, ids: Index, other: "Dither") -> "Dither":
        """Return this dither with the rows of simulations ``ids`` (M,) from ``other``."""
        mine, theirs = (len(ids), self.n), (other.N, other.n)
        if mine != theirs:
            raise StictionError(f"set_rows (N, n) is {theirs}: expected {mine}")
        fields = {name: getattr(self, name).copy() for name in _ROWS}
        for name, values in fields.items():
            values[ids] = getattr(other, name)
        drawn = {}
        for name, some in {**self._drawn, **other._drawn}.items():
            drawn[name] = np.zeros((self.N, *some.shape[1:]))
            drawn[name][:] = self._drawn.get(name, 0.0)
            drawn[name][ids] = other._drawn.get(name, 0.0)
        return self._derive(**fields, _drawn=drawn)

    def _fill(self, **fields: object) -> None:
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def _derive(self, **fields: object) -> "Dither":
        """Return a copy with some fields replaced by checked ones."""
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
        waveforms = list(WAVEFORMS.values())
        codes = sorted(set(self.waveform[driven].tolist()))
        gate = 1.0 / self.gate_velocity if np.isfinite(self.gate_velocity).any() else None
        shifted = bool(self.offset.any())
        plain = gate is None and not shifted and all(waveforms[k].sinusoidal for k in codes)
        for code in () if plain else codes:
            mask = driven & (self.waveform == code)
            where = None if mask.all() else np.flatnonzero(mask)
            rows = None if where is None else where // self.n
            pick: EllipsisType | Bools = ... if where is None else mask
            waveform = waveforms[code]
            drawn = self._drawn.get(waveform.name)
            if drawn is not None:
                drawn = np.ascontiguousarray(np.moveaxis(drawn, -1, 0)[:, pick])
            branches.append(
                (waveform, where, rows, omega[pick], phase[pick], self.amplitude[pick], drawn)
            )
        self._fill(
            _branches=tuple(branches),
            sines=(omega, phase, self.amplitude) if plain else None,
            _gate=gate,
            # A closed gate may leave −0.0, which adding the (then zero) offset turns into 0.0.
            _constant=self.offset + 0.0 if shifted or gate is not None else None,
        )

    def _draw(self) -> dict[str, Array]:
        """Return constants that waveforms draw for their entries, (N, n, K), 0 elsewhere."""
        out = {}
        for code, (name, waveform) in enumerate(WAVEFORMS.items()):
            row, joint = np.nonzero(self.waveform == code)
            values = waveform.draw(self.seed[row], joint) if row.size else None
            if values is not None and values.shape[1]:
                out[name] = np.zeros((self.N, self.n, values.shape[1]))
                out[name][row, joint] = values
        return out


_ROWS = ("amplitude", "frequency", "phase", "offset", "waveform", "gate_velocity", "seed")


def _broadcast(name: str, array: NDArray[_Scalar], shape: tuple[int, ...]) -> NDArray[_Scalar]:
    """Return a C-ordered copy of ``array`` in ``shape``."""
    try:
        return np.broadcast_to(array, shape).copy(order="C")
    except ValueError:
        raise StictionError(f"dither {name} has shape {array.shape}: expected {shape}") from None


def _check(name: str, values: Array, bad: Bools, expected: str) -> None:
    """Raise, naming the first bad entry of (N, n) values by simulation from 0 and joint from 1."""
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise StictionError(
            f"dither {name} of simulation {i}, joint {j + 1} is {values[i, j]}: expected {expected}"
        )


def _codes(waveform: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.int8]:
    array = np.asarray(waveform)
    for name in np.unique(array.astype(str)):
        named(str(name))
    codes = np.zeros(array.shape, dtype=np.int8)
    for code, name in enumerate(WAVEFORMS):
        codes[array == name] = code
    return _broadcast("waveform", codes, shape)


def _seeds(seed: ArrayLike, N: int) -> NDArray[np.uint64]:
    array = np.asarray(seed)
    if array.dtype.kind not in "iu" or (array.size and array.min() < 0):
        got = array.min() if array.dtype.kind == "i" else array.dtype
        raise StictionError(f"dither seed is {got}: expected integers from 0 to 2^64 - 1")
    return _broadcast("seed", array.astype(np.uint64), (N,))


def check_frequency(frequency_hz: float, rate_hz: float) -> str | None:
    """Return a warning if a controller of ``rate_hz`` [Hz] aliases ``frequency_hz`` [Hz].

    None below half the rate; one line from there up to the rate itself (the thesis commanded 100
    and 200 Hz on the iiwa, whose driver runs at 200 Hz by default). Harmonics of the other
    waveforms alias by the same rule. Raise a StictionError for a frequency or rate that is not
    above 0, and for a frequency above the rate.
    """
    for what, value in (("frequency", frequency_hz), ("controller rate", rate_hz)):
        if not (np.isfinite(value) and value > 0):
            raise StictionError(f"{what} {value} Hz: expected > 0")
    where = f"{frequency_hz:g} Hz at a {rate_hz:g} Hz controller"
    if frequency_hz > rate_hz:
        raise StictionError(f"dither frequency {where}: expected at most {rate_hz:g} Hz")
    if 2 * frequency_hz < rate_hz:
        return None
    if 2 * frequency_hz == rate_hz:
        return f"dither of {where} sits at Nyquist: samples are ±A·sin φ"
    if frequency_hz == rate_hz:
        return f"dither of {where} aliases to a constant offset A·sin φ"
    return f"dither of {where} aliases to {rate_hz - frequency_hz:g} Hz"


@compiled
def add_sines(
    omega: Array, phase: Array, amplitude: Array, t: Array, ids: Index, out: Array
) -> None:
    """Add the sines of simulations ids (M,) at times t (M, K) [s] to torques (M, K, n) [N·m]."""
    for row in range(out.shape[0]):
        i = ids[row]
        for k in range(out.shape[1]):
            for j in range(out.shape[2]):
                if amplitude[i, j] > 0.0:
                    value = np.sin(omega[i, j] * t[row, k] + phase[i, j]) * amplitude[i, j]
                    out[row, k, j] += value
