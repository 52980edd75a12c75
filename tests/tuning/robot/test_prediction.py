"""Candidates from bounds and a displacement limit, with physics worked out by hand."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from tests.refusal import refusal
from tuning.robot.prediction import grid, predict
from tuning.search.bounds import bounds_of
from tuning.search.breakaway import Breakaway
from tuning.settings import tuning_settings

S = tuning_settings().robot


class Springs:
    """Instead of simulations: a joint swings by A/(J ω²), a tenth of A is off the torque."""

    def __init__(self, bounds, limit):
        self.bounds, self.displacement, self.ran = bounds, np.full(7, limit), 0

    def measure(self, rows):
        out = {}
        for row in rows:
            self.ran += 1
            swing = row.amplitude_nm / (0.5 * (2 * np.pi * row.frequency_hz) ** 2)
            ratio = np.full((1, 4), 1.0 - 0.1 * row.amplitude_nm)
            out[row] = Breakaway(tau=ratio, ratio=ratio, oscillation=np.full((1, 4), swing))
        return out


@pytest.fixture(scope="module")
def bounds():
    return bounds_of(SingleJointExperiment("panda"))


def test_every_candidate_keeps_the_limit_and_the_best_come_near_it(bounds):
    c = predict(Springs(bounds, 1e-4), S)[1]
    rms = np.sqrt((c.displacement**2).mean(axis=1))
    assert (rms <= 1e-4).all()
    np.testing.assert_allclose(
        c.displacement[:, 0] * 0.5 * (2 * np.pi * c.frequency_hz) ** 2, c.amplitude_nm
    )
    np.testing.assert_allclose(
        c.predicted, np.repeat(1.0 - 0.1 * c.amplitude_nm[:, None], 4, axis=1)
    )
    for f in np.unique(c.frequency_hz):
        most = bounds.largest(1, float(f))
        a = c.amplitude_nm[c.frequency_hz == f].max()
        at_limit = 1e-4 * 0.5 * (2 * np.pi * f) ** 2
        assert min(most, 0.97 * at_limit) * (1 - 1e-9) <= a <= min(most, at_limit)
    assert len(np.unique(c.frequency_hz)) == S.frequencies, "a slow one lost all its amplitudes"


def test_the_grid_fills_what_a_forbidden_band_leaves(bounds):
    band = dataclasses.replace(bounds, forbidden_hz=((((14.0, 60.0),),) + ((),) * 6))
    rows = grid(band, 1, S)
    frequencies = sorted({r.frequency_hz for r in rows})
    assert len(frequencies) == S.frequencies
    assert 60.0 <= frequencies[0] < 61.0
    assert frequencies[-1] == 80.0
    assert all(band.beyond(r) is None for r in rows)
    nothing = dataclasses.replace(bounds, forbidden_hz=((((14.0, 90.0),),) + ((),) * 6))
    refusal(lambda: grid(nothing, 1, S), "bounds of joint 1 leave no setting")
