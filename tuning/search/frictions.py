"""Frictions under which a setting is tried: the model's, and others that are as plausible."""

from __future__ import annotations

import numpy as np

from stiction_envs.friction.parameters import FrictionParameters, scaled

DRAWN = ("stiction", "rotor_inertia", "bristle_stiffness")
"""Quantities that are drawn; each joint has its own factor."""


def frictions(
    nominal: FrictionParameters, count: int, *, spread: float, seed: int
) -> list[FrictionParameters]:
    """Return ``count`` frictions, the nominal one first.

    Args:
        nominal: friction of one arm.
        count: at least 1.
        spread: standard deviation of the logarithm of every factor [-].
        seed: seed of the factors.
    """
    out = [nominal]
    for k in range(1, count):
        rng = np.random.default_rng([seed, k])
        factors = {name: np.exp(spread * rng.normal(size=nominal.n)) for name in DRAWN}
        out.append(scaled(nominal, factors))
    return out
