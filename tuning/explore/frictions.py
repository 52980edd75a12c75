"""Frictions under which a setting is tried: the model's, and some that may be true as well."""

from __future__ import annotations

import numpy as np

from stiction_envs.friction.parameters import FrictionParameters, scaled

DRAWN = ("stiction", "rotor_inertia", "bristle_stiffness")
"""Quantities that are drawn, each joint's with a factor of its own."""


def frictions(
    nominal: FrictionParameters, count: int, *, spread: float, seed: int
) -> list[FrictionParameters]:
    """Return ``count`` frictions, the nominal one first.

    Args:
        nominal: of one arm.
        count: at least 1.
        spread: standard deviation of the logarithm of every factor [-].
        seed: of the factors.
    """
    out = [nominal]
    for k in range(1, count):
        rng = np.random.default_rng([seed, k])
        factors = {name: np.exp(spread * rng.normal(size=nominal.n)) for name in DRAWN}
        out.append(scaled(nominal, factors))
    return out
