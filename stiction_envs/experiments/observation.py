"""Names and bounds of the actions and observations of every environment."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.tables import LOADS

Checked = dict[str, Any]  # Valid options of a reset by name, each of its own type
STICTION_FACTOR = 2.5
"""Largest amplitude over the joint's largest stiction [-]; assumed: the thesis went up to 2 base
torques."""
LOWEST_FREQUENCY, HIGHEST_FREQUENCY = 5.0, 100.0
"""Bounds of the action [Hz]; assumed: around thesis 3.3, 15 to 80 Hz on the Panda, 200 Hz on the
iiwa."""


@dataclass(frozen=True)
class Elements:
    """Neighbouring elements of the observation."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str
    _: KW_ONLY
    per_joint: bool = False  # Whether there is one for every joint (name_1 … name_n)
    labels: tuple[str, ...] = ()  # Otherwise: of each element (name_label); empty for a single one

    def names(self, n: int) -> list[str]:
        """Return the names of the elements for an arm of ``n`` joints."""
        labels = [str(j + 1) for j in range(n)] if self.per_joint else self.labels
        return [f"{self.name}_{label}" for label in labels] or [self.name]


TORQUE = Elements(
    "torque", -50.0, 50.0, "stiction", "commanded torque, dither excluded", per_joint=True
)
"""Part of every environment's observation."""
DITHER = (
    Elements("amplitude", -1.0, 1.0, "1", "last amplitude; −1 is 0, +1 is A_max", per_joint=True),
    Elements(
        "frequency", -1.0, 1.0, "1", "last frequency; −1 is f_min, +1 is f_max", per_joint=True
    ),
)
"""Groups of the last action: every environment's observation ends with them."""


def observation_names(n: int, groups: Sequence[Elements]) -> tuple[str, ...]:
    """Return the name of every element of the observation for an arm of ``n`` joints."""
    return tuple(name for g in groups for name in g.names(n))


def observation_bounds(
    n: int, groups: Sequence[Elements]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the lowest and highest observation for an arm of ``n`` joints."""
    counts = [len(g.names(n)) for g in groups]
    low = np.repeat([g.low for g in groups], counts).astype(np.float32)
    return low, np.repeat([g.high for g in groups], counts).astype(np.float32)


def action_bounds(
    parameters: FrictionParameters, poses: Poses, interface: TorqueInterface
) -> tuple[Array, Array]:
    """Return lowest and highest action (2n,): n amplitudes [N·m], then n frequencies [Hz].

    A_max = min(torque limit, 2.5 × the joint's largest stiction: of both poses and directions);
    f_max = min(100 Hz, half the controller's rate). Raise a StictionError for a controller too slow
    for the lowest frequency.
    """
    stiction = largest_stiction(parameters, poses)
    top = np.minimum(interface.torque_limit, STICTION_FACTOR * stiction)
    n = len(top)
    f_max = min(HIGHEST_FREQUENCY, interface.controller_rate_hz / 2)
    if f_max <= LOWEST_FREQUENCY:
        raise StictionError(
            f"controller rate {interface.controller_rate_hz} Hz: expected more than "
            f"{2 * LOWEST_FREQUENCY:g} Hz, for the environments"
        )
    low = np.concatenate([np.zeros(n), np.full(n, LOWEST_FREQUENCY)])
    return low, np.concatenate([top, np.full(n, f_max)])


def largest_stiction(parameters: FrictionParameters, poses: Poses) -> Array:
    """Return the largest stiction of each joint (n,), of both poses and directions [N·m]."""
    levels = [parameters.stiction_at(poses.load[:, k]).max(axis=-1) for k in range(len(LOADS))]
    return np.maximum(*levels)


def named_options(options: Mapping[str, object] | None, expected: Sequence[str]) -> Checked:
    """Return reset options as a dict; raise a StictionError for anything else."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise StictionError(
            f"reset options are a {type(options).__name__}: expected a dict with "
            f"{', '.join(expected)}"
        )
    for name in options:
        if name not in expected:
            raise unknown("reset option", name, expected)
    return dict(options)
