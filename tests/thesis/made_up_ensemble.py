"""Set-ups of the ensemble that nobody ran: sums about the printed ones."""

import numpy as np

from stiction_envs.thesis.ensemble import Member
from stiction_envs.thesis.ensemble_prior import REASONS, draw
from stiction_envs.thesis.ensemble_scores import measured_sums

SET_UP = draw(0).set_up
"""The set-up of them all."""


def made_up(number, *, seed=0, settings=None, scatter=True):
    """Pretend to run a set-up: sums about the printed ones, with a factor of its own."""
    rng = np.random.default_rng([seed, number])
    before, after = (x.reshape(4, 6) for x in measured_sums())
    lift = np.exp(0.3 * rng.normal(size=(4, 6)))
    shifts = np.exp(0.05 * rng.normal(size=(4, 2, 4, 6)))
    levels = np.array([before, after, 1.02 * before, 0.5 * before]) * lift
    sums = levels[:, None] * shifts
    return Member(
        number=number,
        set_up=SET_UP,
        refused=dict.fromkeys(REASONS, 1),
        sums=np.moveaxis(sums, 1, 2),
        flags={"singular": 0, "saturated": 3, "near_limit": int(number == 1)},
    )
