"""The noise floor of a residual: what no cause can explain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.poses import scatter, wander
from stiction_envs.gap.signals.recording import Recording

Array = NDArray[np.float64]


def noise_floor(recording: Recording, noise_tau: Array, residual: Array) -> Array:
    """Return (n,) noise of a residual [N·m]; that of joints that never move holds their creep.

    Args:
        recording: of the logs.
        noise_tau: (n,) noise of the filtered torques [N·m]; NaN for poses alone.
        residual: (T, n) measured less nominal torque [N·m].
    """
    creep = wander(recording.q, residual, recording.rigid, recording.settings.motion)
    return np.maximum(_floor(recording, noise_tau, residual), creep)


def _floor(recording: Recording, noise_tau: Array, residual: Array) -> Array:
    """Return (n,) noise of the residual [N·m]: that of the torque, and of the acceleration.

    The latter grows with frequency: the upper half of the filter's band holds all of it and half
    of the torque's. Medians over windows leave out the few that hold a jump of friction.
    """
    own = recording.settings
    least, distance = own.noise.least_noise, own.friction_state.presliding_distance
    q, dq, ddq, runs = recording.q, recording.dq, recording.ddq, recording.runs
    torque = np.asarray(noise_tau)
    if not np.all(np.isfinite(torque)):
        poses = scatter(q, residual, own.noise)
        return np.full(q.shape[1], least) if poses is None else poses + least
    torque = np.maximum(torque, least)
    direction = recording.smooth(
        bristles(recording.reversal_path, runs, np.full((q.shape[1], 1), distance), own.motion)[
            ..., 0
        ]
    )
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
