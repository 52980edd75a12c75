"""Frictions under which a setting is tried: the model's, and others that are as plausible.

Base torques tell how strong friction is; which frequency frees a joint depends on bristles, rotors
and springs. Where nobody has fitted these (`plausible`), predictions under several frictions say
how far the simulation may be off, and in which way together: see `robot.posterior`.
"""

import numpy as np

from stiction_envs.friction.parameters import GENERIC, FrictionParameters, load_friction, scaled
from tuning.settings import RobotSettings

DRAWN = ("stiction", "rotor_inertia", "bristle_stiffness")
"""Quantities that are drawn; each joint has its own factor."""
UNKNOWN = ("rotor_inertia", "bristle_stiffness")
"""Quantities whose starting values say that a joint was never fitted."""


def frictions(
    nominal: FrictionParameters, count: int, *, spread: float, seed: int
) -> list[FrictionParameters]:
    """Return ``count`` frictions, the nominal one first; ``spread`` is of the ln of factors [-]."""
    out = [nominal]
    for k in range(1, count):
        rng = np.random.default_rng([seed, k])
        factors = {name: np.exp(spread * rng.normal(size=nominal.n)) for name in DRAWN}
        out.append(scaled(nominal, factors))
    return out


def plausible(nominal: FrictionParameters, settings: RobotSettings) -> list[FrictionParameters]:
    """Return the nominal friction, and others where joints have starting values (`generic.toml`).

    In the others these joints have a spring, and rotor, bristles and spring are drawn, the
    logarithm of each normally. An arm of which every joint was fitted has the nominal one alone.
    """
    n, s = nominal.n, settings
    generic = load_friction(GENERIC, n)
    open_ = np.isinf(nominal.joint_stiffness)
    for name in UNKNOWN:
        open_ &= getattr(nominal, name) == getattr(generic, name)
    out = [nominal]
    for k in range(1, s.members if open_.any() else 1):
        drawn = np.random.default_rng([s.seed, k]).normal(size=(3, n))
        spread = np.array([s.spread, s.bristle_spread, s.spread])
        rotor, bristles, spring = np.where(open_, np.exp(spread[:, None] * drawn), 1.0)
        other = scaled(nominal, {"rotor_inertia": rotor, "bristle_stiffness": bristles})
        stiffness = np.where(open_, s.joint_stiffness * spring, nominal.joint_stiffness)
        out.append(other.replace(joint_stiffness=stiffness))
    return out
