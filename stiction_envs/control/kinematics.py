"""The end effector's pose and Jacobian of N simulations, from the engine's own kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import Arguments
from stiction_envs.control.kernels import chain_kinematics, site_kinematics
from stiction_envs.control.rotation import right_matrix
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class EndEffector:
    """Reads the tool point of every simulation of a batch, oriented as the hand.

    The hand's frame is the flange's, turned about its z by the arm's `hand_yaw`. The tool point is
    fixed in the hand's frame; without a tool it is the flange. Each `read` overwrites the arrays.
    """

    def __init__(self, sticking: StickingModel, batch: Batch, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make it for the N simulations of a batch.

        Args:
            sticking: their model.
            batch: the engine's.
            tool: (3,) the tool point from the flange, in the hand's frame [m].
        """
        model = sticking.model
        site = model.site(sticking.arm.end_effector).id
        self._make(sticking, batch.nsim)
        moved = (
            batch.bind("xanchor"),
            batch.bind("xaxis"),
            batch.bind("site_xpos")[:, site],
            batch.bind("xquat")[:, model.site_bodyid[site]],
        )
        # numbered along the chain; an elastic joint's spring turns about the same axis
        self._set(moved, model.dof_jntid[sticking.motor], tool)

    def _make(self, sticking: StickingModel, nsim: int) -> None:
        """Make what `read` writes."""
        # q ⊗ site ⊗ hand as a matrix on q
        half, model = 0.5 * sticking.arm.hand_yaw, sticking.model
        turn = right_matrix(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        self._turn = turn @ right_matrix(model.site_quat[model.site(sticking.arm.end_effector).id])
        n = sticking.n
        self.position = np.zeros((nsim, 3))
        """(N, 3) position of the tool point in the world [m]."""
        self.quaternion = np.zeros((nsim, 4))
        """(N, 4) orientation of the hand in the world, w, x, y, z."""
        self.jacobian = np.zeros((nsim, 6, n))
        """(N, 6, n) geometric Jacobian, translation above rotation [m/rad, 1]."""

    def _set(self, moved: Arguments, joints: Index, tool: ArrayLike) -> None:
        self.arguments: Arguments = (
            *moved,
            joints,
            self._turn,
            np.array(tool, dtype=float),
            self.position,
            self.quaternion,
            self.jacobian,
        )
        """Those of `kernels.site_kinematics`."""

    def read(self) -> None:
        """Update the arrays from the present kinematics of all simulations."""
        site_kinematics(*self.arguments)


class MeasuredEndEffector(EndEffector):
    """The end effector where angles say that it is, which a controller has measured."""

    def __init__(self, sticking: StickingModel, angles: Array, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make it; arguments are those of `EndEffector`, but for the live ``angles`` (N, n)."""
        nsim, n = angles.shape
        self._make(sticking, nsim)
        moved = (
            *np.zeros((2, nsim, n, 3)),
            np.zeros((nsim, 3)),
            np.zeros((nsim, 4)),
        )
        self._chain = (angles, *_chain_of(sticking.arm.bare_model(), sticking.arm.end_effector))
        self._moved = moved
        self._set(moved, np.arange(n), tool)

    def read(self) -> None:
        """Update the arrays from the present angles."""
        chain_kinematics(*self._chain, *self._moved)
        super().read()


def _chain_of(model: mujoco.MjModel, site_name: str) -> tuple[Array, Array, Array, Array, Array]:
    """Return what `kernels.chain_kinematics` needs of a serial arm's rigid model.

    Bodies without joints are put together with the one that they are fixed to.
    """
    site = model.site(site_name).id
    chain, body = [], int(model.site_bodyid[site])
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    shift, turn = np.zeros((model.njnt + 1, 3)), np.zeros((model.njnt + 1, 4))
    turn[:, 0] = 1.0
    j = 0
    for body in reversed(chain):
        _then(shift[j], turn[j], model.body_pos[body], model.body_quat[body])
        j += int(model.body_jntnum[body])
    _then(shift[j], turn[j].copy(), model.site_pos[site], np.array([1.0, 0.0, 0.0, 0.0]))
    return shift, turn, model.jnt_pos.copy(), model.jnt_axis.copy(), model.qpos0.copy()


def _then(shift: Array, turn: Array, more: Array, quaternion: Array) -> None:
    """Put a shift (3,) and a turn (4,) behind others, in place."""
    moved, turned = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(moved, more, turn)
    mujoco.mju_mulQuat(turned, turn, quaternion)
    shift += moved
    turn[:] = turned


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
