"""The noise floor of a residual: the part that no cause can explain.

It is the noise above the band and in its upper half, where there is no motion. Slower noise cannot
be distinguished from the model's error.

A joint at rest can hold any torque inside its friction band. Repeated poses show the scatter: equal
poses differ only by noise and friction. A joint that rests throughout a log while others move is
held by friction in the same way, and its torque creeps, far below the sensors' noise in frequency.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.spatial import cKDTree

from stiction_envs.gap.signals.friction_state import PRESLIDING_DISTANCE
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.measured.motion import TRAVEL_SPAN

Array = NDArray[np.float64]
LEAST = 1e-4
"""Least noise that is assumed [N·m], so that perfect data do not divide by zero; assumed."""
SAME_POSE = 0.03
"""Distance over all joints below which poses are equal [rad]; assumed: 0.2 N·m of gravity in
7 N·m/rad, before the model is subtracted."""
LEAST_PAIRS = 10
"""Least number of pairs of equal poses for an estimate of their scatter [-]; assumed."""


def noise_floor(recording: Recording, residual: Array) -> Array:
    """Return (n,) noise of a residual [N·m]; for joints that never move it includes their creep.

    The residual (T, n) is measured less nominal torque [N·m].
    """
    moving = np.all(np.isfinite(recording.noise_tau))
    floor = _floor(recording, residual) if moving else _scatter(recording.q, residual)
    return np.maximum(floor, _creep(recording, residual))


def _scatter(q: Array, residual: Array) -> Array:
    """Return (n,) scatter of a residual (T, n) between poses (T, n) that are equal [N·m]."""
    least = np.full(q.shape[1], LEAST)
    if len(q) < 2:
        return least
    distance, nearest = cKDTree(q).query(q, k=2)
    first = np.flatnonzero(distance[:, 1] < SAME_POSE)
    pairs = np.unique(np.sort(np.stack([first, nearest[first, 1]], axis=1), axis=1), axis=0)
    if len(pairs) < LEAST_PAIRS:
        return least
    difference = residual[pairs[:, 0]] - residual[pairs[:, 1]]
    return np.asarray(np.sqrt(np.mean(np.square(difference), axis=0) / 2) + least)


def _creep(recording: Recording, residual: Array) -> Array:
    """Return (n,) scatter of joints that never move [N·m], after an offset and a scale; else 0."""
    q, out = recording.q, np.zeros(recording.n)
    for j in np.flatnonzero(np.ptp(q, axis=0) < TRAVEL_SPAN):
        # others' motion changes its rigid torque
        x = np.stack([np.ones(len(q)), recording.rigid[:, j]], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        out[j] = left.std()
    return out


def _floor(recording: Recording, residual: Array) -> Array:
    """Return (n,) noise of the residual along a motion [N·m]: of torque and acceleration.

    The acceleration's noise grows with frequency: the upper half of the filter's band contains all
    of it and half of the torque's. Medians over windows ignore the few that contain a jump of
    friction.
    """
    q, dq, ddq, runs = recording.q, recording.dq, recording.ddq, recording.runs
    torque = np.maximum(recording.noise_tau, LEAST)
    distances = np.full((q.shape[1], 1), PRESLIDING_DISTANCE)
    direction = recording.smooth(recording.bristles(distances)[..., 0])
    longest = max(runs, key=lambda r: r.stop - r.start)
    window = int(min(longest.stop - longest.start, max(32, 1.0 / recording.dt)))
    out = torque.copy()
    for j in range(q.shape[1]):
        x = np.stack([direction[:, j], dq[:, j], ddq[:, j], np.ones(len(q))], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        f, power = welch(
            left[longest], 1 / recording.dt, nperseg=window, nfft=8 * window, average="median"
        )
        high = (f > 0.5 * recording.cutoff) & (f < 1.5 * recording.cutoff)
        upper = float(power[high].sum() * f[1])
        out[j] = np.sqrt(upper + min(0.5 * torque[j] ** 2, upper)) + LEAST
    return out
