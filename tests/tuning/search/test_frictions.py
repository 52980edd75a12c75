"""Frictions that are as plausible as the model's."""

import numpy as np

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from tuning.search.frictions import DRAWN, frictions


def test_the_first_is_the_models_own_and_the_others_spread_about_it():
    nominal = SingleJointExperiment("panda").sticking.parameters
    drawn = frictions(nominal, 400, spread=0.1, seed=3)
    assert drawn[0] is nominal
    for name in DRAWN:
        ratio = np.array([getattr(p, name) for p in drawn[1:]]) / getattr(nominal, name)
        spread = np.log(ratio).std(axis=0)
        assert np.all(np.abs(spread - 0.1) < 0.02)
        assert np.all(np.abs(np.log(ratio).mean(axis=0)) < 0.02)
    up, down = (np.array([p.stiction[:, k] for p in drawn[1:]]) for k in (0, 1))
    assert np.allclose(up / down, nominal.stiction[:, 0] / nominal.stiction[:, 1])
