"""The noise floor of a residual: the part that no cause can explain.

`noise_floor` takes the noise from above the band and from its upper half, where there is no motion.
Torques that were low-passed before logging have more noise than that, at low frequencies.
`slow_noise` finds it once the causes are known: what they leave falls with frequency until noise
dominates, and the noise below is taken to have the same density. Noise that is slower than the
model's error cannot be distinguished from it.

A joint at rest can hold any torque inside its friction band. Repeated poses show the scatter: equal
poses differ only by noise and friction. A joint that rests throughout a log while others move is
held by friction in the same way, and its torque creeps, far below the sensors' noise in frequency.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.spatial import cKDTree

from stiction_envs.gap.signals.friction_state import PRESLIDING_DISTANCE
from stiction_envs.gap.signals.recording import Recording

Array = NDArray[np.float64]
LONGEST_WINDOW = 2.0
"""Longest window of the spectrum for slow noise [s]; assumed: two periods of the slowest noise."""
LEAST_WINDOWS = 4.0
"""Least number of windows that fit into the longest run [-]; assumed."""
LEAST_PAIRS = 10
"""Least number of pairs of equal poses for an estimate of their scatter [-]; assumed."""
LEVEL = 2.0
"""Largest ratio of a spectrum to its median in the octave above where it is flat [-]; assumed."""


def noise_floor(recording: Recording, noise_tau: Array, residual: Array) -> Array:
    """Return (n,) noise of a residual [N·m]; for joints that never move it includes their creep.

    Args:
        recording: of the logs.
        noise_tau: (n,) noise of the filtered torques [N·m]; NaN for poses alone.
        residual: (T, n) measured less nominal torque [N·m].
    """
    return np.maximum(_floor(recording, noise_tau, residual), _creep(recording, residual))


def slow_noise(recording: Recording, left: Array, motion_hz: float) -> tuple[Array, Array]:
    """Return (n,) noise of a residual from where it dominates [N·m], and (n,) that frequency [Hz].

    The spectrum S stops falling at the lowest f with S(f) ≤ `LEVEL`·median of S, the octave above
    (as in `spectra`, which uses three octaves: a low-pass before the log may leave only one). Above
    it everything is noise, and below it the noise is taken to have the same density:
    σ² = f S(f) + ∫_f S. For white noise this is the whole noise. NaN where there is no such point,
    as the noise is then not visible, or where it is in the band of the motion, which also contains
    the model's error.

    Args:
        recording: of the logs.
        left: (T, n) torque that the extended model leaves [N·m].
        motion_hz: upper end of the motion's band [Hz].
    """
    n = left.shape[1]
    sigma, start = np.full(n, np.nan), np.full(n, np.nan)
    longest = max(recording.runs, key=lambda r: r.stop - r.start)
    rows = longest.stop - longest.start
    if not np.isfinite(recording.dt):
        return sigma, start
    window = int(min(rows / LEAST_WINDOWS, LONGEST_WINDOW / recording.dt))
    if window < 16:
        return sigma, start
    f, power = welch(left[longest], 1 / recording.dt, nperseg=window, average="median", axis=0)
    # by half octaves; the lowest frequency contains the window's leakage
    edges = np.searchsorted(f, 2 * f[1] * 2 ** (np.arange(40) / 2) * (1 - 1e-9))
    edges = np.unique(edges[f[np.minimum(edges, len(f) - 1)] < recording.cutoff])
    level = np.array([power[a:b].mean(axis=0) for a, b in pairwise(edges)]).reshape(-1, n)
    for j in range(n):
        for i, at in enumerate(edges[: max(len(level) - 2, 0)]):
            if level[i, j] <= LEVEL * np.median(level[i + 1 : i + 3, j]):
                if f[at] <= motion_hz:
                    break
                start[j] = f[at]
                dense = level[i : i + 2, j].mean()
                sigma[j] = np.sqrt(f[at] * dense + power[at:, j].sum() * f[1])
                break
    return sigma, start


def scatter(q: Array, residual: Array, same_pose: float) -> Array | None:
    """Return (n,) scatter of a residual (T, n) between equal poses [N·m]; None without enough.

    Args:
        q: (T, n) [rad].
        residual: measured less nominal torque [N·m].
        same_pose: distance of poses below which they are equal [rad].
    """
    if len(q) < 2:
        return None
    distance, nearest = cKDTree(q).query(q, k=2)
    first = np.flatnonzero(distance[:, 1] < same_pose)
    pairs = np.unique(np.sort(np.stack([first, nearest[first, 1]], axis=1), axis=1), axis=0)
    if len(pairs) < LEAST_PAIRS:
        return None
    difference = residual[pairs[:, 0]] - residual[pairs[:, 1]]
    return np.asarray(np.sqrt(np.mean(np.square(difference), axis=0) / 2))


def _creep(recording: Recording, residual: Array) -> Array:
    """Return (n,) scatter of joints that never move [N·m], after an offset and a scale; else 0."""
    q, out = recording.q, np.zeros(recording.n)
    for j in np.flatnonzero(np.ptp(q, axis=0) < recording.settings.motion.travel_span):
        # others' motion changes its rigid torque
        x = np.stack([np.ones(len(q)), recording.rigid[:, j]], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        out[j] = left.std()
    return out


def _floor(recording: Recording, noise_tau: Array, residual: Array) -> Array:
    """Return (n,) noise of the residual [N·m]: that of the torque, and that of the acceleration.

    The latter grows with frequency: the upper half of the filter's band contains all of it and half
    of the torque's. Medians over windows ignore the few that contain a jump of friction.
    """
    own = recording.settings
    least = own.noise.least_noise
    q, dq, ddq, runs = recording.q, recording.dq, recording.ddq, recording.runs
    torque = np.asarray(noise_tau)
    if not np.all(np.isfinite(torque)):
        poses = scatter(q, residual, own.noise.same_pose)
        return np.full(q.shape[1], least) if poses is None else poses + least
    torque = np.maximum(torque, least)
    distances = np.full((q.shape[1], 1), PRESLIDING_DISTANCE)
    direction = recording.smooth(recording.bristles(distances)[..., 0])
    longest = max(runs, key=lambda r: r.stop - r.start)
    window = int(min(longest.stop - longest.start, max(32, 1.0 / recording.dt)))
    out = torque.copy()
    for j in range(q.shape[1]):
        x = np.stack([direction[:, j], dq[:, j], ddq[:, j], np.ones(len(q))], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        f, power = welch(left[longest], 1 / recording.dt, nperseg=window, average="median")
        high = (f > 0.5 * recording.cutoff) & (f < 1.5 * recording.cutoff)
        upper = float(power[high].sum() * f[1])
        out[j] = np.sqrt(upper + min(0.5 * torque[j] ** 2, upper)) + least
    return out
