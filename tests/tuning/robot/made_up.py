"""A joint with made-up settings, for tests that need no simulation."""

from __future__ import annotations

import numpy as np

from tuning.robot.posterior import Candidates, Posterior, Readings
from tuning.settings import tuning_settings

S = tuning_settings().robot


def joint(predicted: np.ndarray, frequencies: np.ndarray | None = None) -> Candidates:
    """Return settings with the same prediction in all four configurations."""
    s = len(predicted)
    f = np.geomspace(15.0, 80.0, s) if frequencies is None else frequencies
    return Candidates(
        joint=1,
        frequency_hz=f,
        amplitude_nm=np.ones(s),
        predicted=np.repeat(np.asarray(predicted, dtype=float)[:, None], 4, axis=1),
        displacement=np.repeat(1e-4 / f[:, None], 4, axis=1),
        deviation=np.zeros((1, s, 4)),
        eligible=np.ones(s, dtype=bool),
    )


def read(truth: np.ndarray, settings: list[int]) -> Readings:
    """Return readings of all cells of settings; truth (S, 4)."""
    return Readings(len(truth), [(s, c, float(truth[s, c])) for s in settings for c in range(4)])


def posterior_of(candidates: Candidates, readings: Readings) -> Posterior:
    return Posterior(candidates, readings, S)
