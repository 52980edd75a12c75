"""Arms of an environment that differ from episode to episode: domain randomisation.

Each number of a joint is multiplied by a factor, uniform in [1 − spread, 1 + spread], drawn for
every joint and episode from that episode's generator. The controller, the bounds of the action and
the units of observation and reward remain the nominal arm's: they are what a person knows.
"""

from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.parameters import FrictionParameters, scaled
from stiction_envs.method_settings import FinitePositive, checked

Spread = Annotated[float, msgspec.Meta(ge=0, lt=1)]
FIELDS: dict[str, tuple[str, ...]] = {
    "friction": ("stiction", "load_coefficient"),
    "rotor": ("rotor_inertia",),
    "bristles": ("bristle_stiffness",),
    "load": ("load_coefficient",),
}
"""Fields of the friction that a spread is about; Coulomb friction is a share of the stiction."""


def check_spreads(
    randomise: Mapping[str, float] | None, sticking: StickingModel
) -> dict[str, float]:
    """Return the spread of each of `FIELDS`, or nothing where all are 0.

    Raise a StictionError for an unknown name, a spread outside [0, 1), or chattering bristles.
    """
    if randomise is not None and not isinstance(randomise, Mapping):
        raise StictionError(
            f"randomise is a {type(randomise).__name__}: expected a dict with {', '.join(FIELDS)}"
        )
    spreads = dict.fromkeys(FIELDS, 0.0)
    for name, value in (randomise or {}).items():
        if name not in FIELDS:
            raise unknown("spread to randomise", name, FIELDS)
        spreads[name] = checked(value, Spread, f"randomise {name}")
    if not any(spreads.values()):
        return {}
    try:  # the lightest rotor under the stiffest bristles
        worst = -np.ones((1, len(FIELDS), sticking.n))
        worst[:, list(FIELDS).index("bristles")] = 1.0
        sticking.bristle_damping_of(randomised(sticking.parameters, spreads, worst))
    except StictionError as error:
        raise StictionError(f"randomise {dict(randomise or {})}: {error}") from None
    return spreads


def true_friction(sticking: StickingModel, factor: float) -> FrictionParameters:
    """Return the friction of an arm whose fields of ``friction`` are times a factor > 0."""
    if checked(factor, FinitePositive, "friction_factor") == 1:
        return sticking.parameters
    return scaled(sticking.parameters, dict.fromkeys(FIELDS["friction"], factor))


def randomised(
    parameters: FrictionParameters, spreads: Mapping[str, float], drawn: Array
) -> FrictionParameters:
    """Return the friction of M arms.

    ``spreads`` are those of `FIELDS`, ``drawn`` (M, spreads, n) is in [−1, 1].
    """
    out = parameters.tile(len(drawn))
    for k, (name, fields) in enumerate(FIELDS.items()):
        out = scaled(out, dict.fromkeys(fields, 1.0 + spreads[name] * drawn[:, k]))
    return out
