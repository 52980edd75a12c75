"""Parts of an excitation: a Fourier series that rests once a period, and slow sweeps."""

import functools
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly
from scipy.linalg import null_space

from stiction_envs.arrays import Array

SPEEDS = (0.02, 0.08, 0.3)
"""Speeds of the sweeps [rad/s]; assumed: below, at and above usual Stribeck velocities."""
SPAN = 0.3  # largest angle of a sweep [rad]; assumed
SECONDS = 4.0  # longest time of one direction [s]; assumed
RISE = 0.3  # time from rest to speed [s]; assumed
PAUSE = 0.5  # time at rest between two directions [s]; assumed
State = tuple[Array, Array, Array]
"""Angles [rad], speeds [rad/s] and accelerations [rad/s²], (T, n) each."""


@functools.lru_cache
def rest_basis(harmonics: int) -> Array:
    """Return (2 N, 2 N − 2) coefficients of series that rest at the start of each period.

    Zero speed is Σ a_k = 0, zero acceleration Σ k b_k = 0.
    """
    k = np.arange(1, harmonics + 1)
    rows = np.zeros((2, 2 * harmonics))
    rows[0, :harmonics] = 1.0
    rows[1, harmonics:] = k
    out = null_space(rows)
    # the SVD's signs are the library's; the same series everywhere
    out *= np.sign(out[np.abs(out).argmax(axis=0), np.arange(out.shape[1])])
    out.flags.writeable = False
    return np.asarray(out)


@dataclass(frozen=True, kw_only=True, eq=False)
class FourierSeries:
    """q(t) = offset + Σ_k a_k/(kω) sin(kωt) − b_k/(kω) cos(kωt) for each joint.

    After J. Swevers et al., "Optimal robot excitation and identification", IEEE Transactions on
    Robotics and Automation 13(5), 1997.
    """

    base_frequency: float
    """ω/2π [Hz]."""
    offset: Array
    """(n,) [rad]."""
    sine: Array
    """(n, N) a_k [rad/s]."""
    cosine: Array
    """(n, N) b_k [rad/s]."""

    def state(self, t: Array) -> State:
        """Return q, dq, ddq, (T, n) each, at times (T,)."""
        p, v, a = fourier_basis(t, self.base_frequency, self.sine.shape[1])
        c = np.hstack([self.sine, self.cosine]).T
        return self.offset + p @ c, v @ c, a @ c


def fourier_basis(t: Array, base_frequency: float, harmonics: int) -> State:
    """Return (T, 2 N) angle, speed and acceleration per unit of a_1..a_N, b_1..b_N."""
    w = 2 * np.pi * base_frequency * np.arange(1, harmonics + 1)
    s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    return np.hstack([s / w, -c / w]), np.hstack([c, s]), np.hstack([-w * s, w * c])


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Slow motions there and back at constant speeds, with rests between; all joints together."""

    paths: tuple[BPoly, ...]
    """Angle of each joint over time [rad]."""
    duration: float
    """[s]."""

    def state(self, t: Array) -> State:
        """Return q, dq, ddq, (T, n) each, at times (T,)."""
        q, dq, ddq = (np.stack([x(t, nu) for x in self.paths], axis=1) for nu in range(3))
        return q, dq, ddq


def sweeps_from(
    start: Array, low: Array, high: Array, *, side: Array | None = None, part: float = 1.0
) -> Sweeps:
    """Return there-and-back sweeps of all joints from a pose (n,), between angles (n,) [rad].

    ``side`` (n,) ±1 are the first directions, by default towards the middle of the ranges; ``part``
    is that of the largest span.
    """
    if side is None:
        side = np.where(start > (low + high) / 2, -1.0, 1.0)
    room = np.where(side > 0, high - start, start - low)
    knots: list[dict[float, list[float]]] = [{0.0: [q, 0.0, 0.0]} for q in start]
    begin = 0.0
    for speed in SPEEDS:
        span = np.minimum(part * min(SPAN, speed * SECONDS), room)
        span = np.maximum(span, speed * RISE)  # shorter ones never reach the speed
        done = span / speed + RISE  # of each joint
        for way, origin in ((side, start), (-side, start + side * span)):
            for mine, at, to, v, seconds in zip(
                knots, origin, origin + way * span, way * speed, done, strict=True
            ):
                mine[begin] = [at, 0.0, 0.0]
                mine[begin + RISE] = [at + v * RISE / 2, v, 0.0]
                mine[max(begin + seconds - RISE, begin + RISE)] = [to - v * RISE / 2, v, 0.0]
                mine[begin + seconds] = [to, 0.0, 0.0]
            begin += float(done.max()) + PAUSE
    for mine, at in zip(knots, start, strict=True):
        mine[begin] = [at, 0.0, 0.0]
    # the acceleration begins and ends at zero
    return Sweeps(tuple(BPoly.from_derivatives(list(x), list(x.values())) for x in knots), begin)
