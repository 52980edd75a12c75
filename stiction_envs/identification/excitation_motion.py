"""Parts of an excitation: a Fourier series that rests once a period, and slow sweeps."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweeps:
    """Slow motions there and back at constant speeds, with rests between; all joints together."""

    start: Array
    """(n,) pose at the beginning and the end [rad]."""
    span: Array
    """(W, n) signed angle of each sweep [rad]."""
    speed: Array
    """(W, n) cruising speed, without sign [rad/s]."""

    @property
    def durations(self) -> Array:
        """(W,) of each sweep with its pause [s]: that of its slowest joint."""
        own = np.abs(self.span) / self.speed + RISE
        return np.asarray(own.max(axis=1) + PAUSE)

    @property
    def duration(self) -> float:
        """Duration of all sweeps [s]."""
        return float(self.durations.sum())

    def state(self, t: Array) -> State:
        """Return q, dq, ddq, (T, n) each, at times (T,)."""
        q = np.tile(self.start, (len(t), 1))
        dq, ddq = np.zeros_like(q), np.zeros_like(q)
        begin = 0.0
        for span, speed, seconds in zip(self.span, self.speed, self.durations, strict=True):
            done = np.abs(span) / speed + RISE  # of each joint
            x = np.clip(t[:, None] - begin, 0.0, done)
            up, down = np.minimum(x, RISE), np.clip(x - (done - RISE), 0.0, RISE)
            v = speed * np.sign(span)
            # speed rises as 3s² − 2s³, so that the acceleration begins and ends at zero
            su, sd = up / RISE, down / RISE
            flat = np.clip(x - RISE, 0.0, None)
            q += v * (RISE * (su**3 - su**4 / 2) + flat)
            q -= v * RISE * (sd**3 - sd**4 / 2)
            moving = (x > 0) & (x < done)
            rate = (su**2 * (3 - 2 * su)) - (sd**2 * (3 - 2 * sd))
            dq += np.where(moving, v * rate, 0.0)
            slope = (6 * su * (1 - su) - 6 * sd * (1 - sd)) / RISE
            ddq += np.where(moving, v * slope, 0.0)
            begin += float(seconds)
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
    spans, speeds = [], []
    for speed in SPEEDS:
        span = np.minimum(part * min(SPAN, speed * SECONDS), room)
        least = np.maximum(span, speed * RISE)  # shorter ones never reach the speed
        spans += [side * least, -side * least]
        speeds += [np.full_like(start, speed)] * 2
    return Sweeps(start=start, span=np.array(spans), speed=np.array(speeds))
