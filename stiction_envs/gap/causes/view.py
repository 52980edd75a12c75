"""What a cause is drawn against: the variable that shows it best in a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data

Array = NDArray[np.float64]
Shape = tuple[float, ...]


@dataclass(frozen=True)
class View:
    """The abscissa of a cause's picture; the ordinate is the residual torque."""

    label: str
    """Of the axis, with its unit."""
    of: Callable[[Data, int, Shape], Array] | None
    """(T,) variable of a joint (from 0) for nonlinear parameters; None for the torque that the
    cause itself predicts."""
    folded: bool = False
    """Whether torques are counted in the direction of motion."""
    note: str = ""
    """What to look for, a clause."""
    limit: Callable[[Shape], float] | None = None
    """Size of the variable up to which it is drawn; None for all of it."""


def angle(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) the joint's angle [rad]."""
    return data.q[:, joint]


def speed(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) the joint's speed [rad/s]."""
    return data.dq[:, joint]


def load(data: Data, joint: int, shape: Shape) -> Array:
    """Return (T,) the torque that the joint transmits [N·m]."""
    return data.rigid[:, joint]


OWN_TORQUE = View(
    "torque that the cause predicts [N·m]",
    None,
    note="on the diagonal the cause is right in every pose",
)
"""For causes that no single variable shows."""
