"""The end effector's pose and Jacobian of N simulations.

They come from the engine's kinematics of the simulation, or of a rigid arm at measured joint
angles. Simulations are computed one after the other: the same bits in any batch.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.rotation import right_matrix
from stiction_envs.friction.model import StickingModel
from stiction_envs.plant.loop_batch import kinematics
from stiction_envs.robots import Arm


class Hand(NamedTuple):
    """A point and a frame fixed to a site, for N simulations."""

    anchor: Array  # (N, joints of the model, 3) a point of each joint's axis in the world [m]
    axis: Array  # (N, joints of the model, 3) the direction of each joint's axis
    site_position: Array  # (N, sites, 3) [m]
    body_quaternion: Array  # (N, bodies, 4) w, x, y, z
    site: int  # Number of the site
    body: int  # Number of the site's body
    joints: Index  # (n,) the joints that move the site
    turn: Array  # (4, 4) the frame in the site's body: q ⊗ q_frame as a matrix on q
    tool: Array  # (3,) the point, from the site in the frame [m]
    position: Array  # (N, 3) of the point, written by `read_hand` [m]
    quaternion: Array  # (N, 4) of the frame, written by `read_hand`
    jacobian: Array  # (N, 6, n) translation above rotation, written by `read_hand` [m/rad, 1]


class MeasuredHand(NamedTuple):
    """A rigid arm in which the hands of all simulations are computed in turn."""

    model: int
    data: int  # Their addresses
    qpos: Array  # (n,) of the data [rad]
    q: Array  # (N, n) measured angles [rad]
    hand: Hand  # Kinematics of the data, of one simulation


_LIVE = "xanchor", "xaxis", "site_xpos", "xquat"  # MuJoCo's names of the first arrays of a `Hand`


@inlined
def read_hand(i: int, row: int, hand: Hand) -> None:
    """Write position, quaternion and Jacobian of simulation ``i`` from a row of the kinematics."""
    position, quaternion, jacobian = hand.position, hand.quaternion, hand.jacobian
    for k in range(4):
        total = 0.0
        for m in range(4):
            total += hand.turn[k, m] * hand.body_quaternion[row, hand.body, m]
        quaternion[i, k] = total
    # R(q) p = p + 2 w (v × p) + 2 v × (v × p)
    w, a, b, c = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
    px, py, pz = hand.tool[0], hand.tool[1], hand.tool[2]
    tx = 2.0 * (b * pz - c * py)
    ty = 2.0 * (c * px - a * pz)
    tz = 2.0 * (a * py - b * px)
    x = hand.site_position[row, hand.site, 0] + (px + w * tx + (b * tz - c * ty))
    y = hand.site_position[row, hand.site, 1] + (py + w * ty + (c * tx - a * tz))
    z = hand.site_position[row, hand.site, 2] + (pz + w * tz + (a * ty - b * tx))
    position[i, 0], position[i, 1], position[i, 2] = x, y, z
    for j in range(len(hand.joints)):
        joint = hand.joints[j]
        ux, uy, uz = hand.axis[row, joint]
        ax, ay, az = hand.anchor[row, joint]
        dx, dy, dz = x - ax, y - ay, z - az
        jacobian[i, 0, j] = uy * dz - uz * dy
        jacobian[i, 1, j] = uz * dx - ux * dz
        jacobian[i, 2, j] = ux * dy - uy * dx
        jacobian[i, 3, j], jacobian[i, 4, j], jacobian[i, 5, j] = ux, uy, uz


@inlined
def read_measured(i: int, a: MeasuredHand) -> None:
    """Write position, quaternion and Jacobian of simulation ``i`` at its measured angles."""
    for j in range(len(a.qpos)):
        a.qpos[j] = a.q[i, j]
    kinematics(a.model, a.data)
    read_hand(i, 0, a.hand)


@compiled
def _read_hands(hand: Hand) -> None:
    for i in range(len(hand.position)):
        read_hand(i, i, hand)


@compiled
def _read_all_measured(a: MeasuredHand) -> None:
    for i in range(len(a.q)):
        read_measured(i, a)


class EndEffector:
    """Reads the tool point of every simulation of a batch, oriented as the hand.

    The hand's frame is the flange's, turned about its z by the arm's `hand_yaw`. The tool point is
    fixed in the hand's frame; without a tool it is the flange. Each `read` overwrites the arrays.
    """

    def __init__(self, sticking: StickingModel, batch: Batch, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make the end effectors of the N simulations of a batch.

        ``tool`` (3,) is the tool point from the flange, in the hand's frame [m].
        """
        model = sticking.model
        self._allocate(batch.nsim, sticking.n)
        live = [batch.bind(name) for name in _LIVE]
        # numbered along the chain; an elastic joint's spring turns about the same axis
        joints = model.dof_jntid[sticking.motor].astype(np.int64)
        self.arrays = self._hand(sticking.arm, model, live, joints, tool)
        """Arrays that compiled functions read and write; always the same objects."""

    def _allocate(self, nsim: int, n: int) -> None:
        self.position = np.zeros((nsim, 3))
        """(N, 3) position of the tool point in the world [m]."""
        self.quaternion = np.zeros((nsim, 4))
        """(N, 4) orientation of the hand in the world, w, x, y, z."""
        self.jacobian = np.zeros((nsim, 6, n))
        """(N, 6, n) geometric Jacobian, translation above rotation [m/rad, 1]."""

    def _hand(
        self, arm: Arm, model: mujoco.MjModel, live: list[Array], joints: Index, tool: ArrayLike
    ) -> Hand:
        site = model.site(arm.end_effector).id
        # q ⊗ site ⊗ hand as a matrix on q
        half = 0.5 * arm.hand_yaw
        turn = right_matrix(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        return Hand(
            anchor=live[0],
            axis=live[1],
            site_position=live[2],
            body_quaternion=live[3],
            site=site,
            body=int(model.site_bodyid[site]),
            joints=joints,
            turn=turn @ right_matrix(model.site_quat[site]),
            tool=np.array(tool, dtype=float),
            position=self.position,
            quaternion=self.quaternion,
            jacobian=self.jacobian,
        )

    def read(self) -> None:
        """Update the arrays from the present kinematics of all simulations."""
        _read_hands(self.arrays)


class MeasuredEndEffector(EndEffector):
    """The end effector of a rigid arm at the angles that its controller has measured."""

    def __init__(self, arm: Arm, angles: Array, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make the end effectors at the live ``angles`` (N, n); see `EndEffector`."""
        self._allocate(*angles.shape)
        self._arm, self._angles, self._tool = arm, angles, tool
        self._model = arm.bare_model()
        self._made: list[tuple[MeasuredHand, mujoco.MjData]] = []

    def __getstate__(self) -> dict[str, object]:
        """Leave out the arrays with addresses of this process; `measured` makes new ones."""
        return vars(self) | {"_made": []}

    def measured(self, part: int = 0) -> MeasuredHand:
        """Return the arrays of `read_measured`; each part of the arms has separate data."""
        while len(self._made) <= part:
            model, data = self._model, mujoco.MjData(self._model)
            live = [getattr(data, name)[None] for name in _LIVE]
            hand = self._hand(self._arm, model, live, np.arange(model.njnt), self._tool)
            arrays = MeasuredHand(model._address, data._address, data.qpos, self._angles, hand)
            self._made.append((arrays, data))  # compiled code has addresses only
        return self._made[part][0]

    def read(self) -> None:
        """Update the arrays from the present angles."""
        _read_all_measured(self.measured())
