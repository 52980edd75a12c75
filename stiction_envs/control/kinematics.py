"""The end effector's pose and Jacobian of N simulations, from the engine's own kinematics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.kernels import site_kinematics
from stiction_envs.friction.model import StickingModel

Array = NDArray[np.float64]


class EndEffector:
    """Reads the flange of every simulation of a batch; arrays are overwritten by each `read`."""

    def __init__(self, sticking: StickingModel, batch: Any) -> None:
        model = sticking.model
        site = model.site(sticking.arm.end_effector).id
        w, x, y, z = model.site_quat[site]
        # q ⊗ site as a matrix on q
        turn = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
        nsim, n = batch.nsim, sticking.n
        self.position = np.zeros((nsim, 3))
        """(N, 3) flange position in the world [m]."""
        self.quaternion = np.zeros((nsim, 4))
        """(N, 4) flange orientation in the world, w, x, y, z."""
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
            self.position,
            self.quaternion,
            self.jacobian,
        )
        """Those of `kernels.site_kinematics`."""

    def read(self) -> None:
        """Take the present kinematics of all simulations."""
        site_kinematics(*self.arguments)
