"""The end effector's pose and Jacobian of N simulations, from the engine's own kinematics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.kernels import site_kinematics
from stiction_envs.control.rotation import right_matrix
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel

Array = NDArray[np.float64]


class EndEffector:
    """Reads the tool point of every simulation of a batch, oriented as the hand.

    The hand's frame is the flange's, turned about its z by the arm's `hand_yaw`. The tool point is
    fixed in the hand's frame; without a tool it is the flange. Each `read` overwrites the arrays.
    """

    def __init__(self, sticking: StickingModel, batch: Any, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make it for the N simulations of a batch.

        Args:
            sticking: their model.
            batch: the engine's.
            tool: (3,) the tool point from the flange, in the hand's frame [m].
        """
        model = sticking.model
        site = model.site(sticking.arm.end_effector).id
        # q ⊗ site ⊗ hand as a matrix on q
        half = 0.5 * sticking.arm.hand_yaw
        turn = right_matrix(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        turn = turn @ right_matrix(model.site_quat[site])
        nsim, n = batch.nsim, sticking.n
        self.position = np.zeros((nsim, 3))
        """(N, 3) position of the tool point in the world [m]."""
        self.quaternion = np.zeros((nsim, 4))
        """(N, 4) orientation of the hand in the world, w, x, y, z."""
        self.jacobian = np.zeros((nsim, 6, n))
        """(N, 6, n) geometric Jacobian, translation above rotation [m/rad, 1]."""

        self.arguments: tuple[Any, ...] = (
            batch.bind("xanchor"),
            batch.bind("xaxis"),
            batch.bind("site_xpos")[:, site],
            batch.bind("xquat")[:, model.site_bodyid[site]],
            # numbered along the chain; an elastic joint's spring turns about the same axis
            model.dof_jntid[sticking.motor],
            turn,
            np.array(tool, dtype=float),
            self.position,
            self.quaternion,
            self.jacobian,
        )
        """Those of `kernels.site_kinematics`."""

    def read(self) -> None:
        """Update the arrays from the present kinematics of all simulations."""
        site_kinematics(*self.arguments)


def tool_point(tool: ArrayLike | None) -> Array:
    """Return a tool point (3,) [m], the flange for None.

    Raises:
        StictionError: not three finite numbers.
    """
    try:
        point = np.array((0.0, 0.0, 0.0) if tool is None else tool, dtype=float)
    except (TypeError, ValueError):
        point = np.full(0, np.nan)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise StictionError(f"tool {tool!r}: expected three finite numbers, x y z in m")
    return point
