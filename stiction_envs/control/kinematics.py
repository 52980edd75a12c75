"""The end effector's pose and Jacobian of N simulations.

They come from the engine's own kinematics, or from measured joint angles. Simulations are computed
one after the other in plain arithmetic: a simulation's result is the same bits in any batch.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.rotation import right_matrix
from stiction_envs.errors import checked_array
from stiction_envs.friction.model import StickingModel


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


class Chain(NamedTuple):
    """A serial arm's rigid links, for `follow_chain`."""

    q: Array  # (N, n) joint angles [rad]
    shift: Array  # (n + 1, 3) from joint body to joint body, then to the site [m]
    turn: Array  # (n + 1, 4) the turns between the same bodies, w, x, y, z
    joint_shift: Array  # (n, 3) each joint's place in its body [m]
    joint_axis: Array  # (n, 3) each joint's axis in its body
    zero: Array  # (n,) angles at which bodies are turned by `turn` alone [rad]


@inlined
def read_hand(i: int, hand: Hand) -> None:
    """Write position, quaternion and Jacobian of simulation ``i``."""
    position, quaternion, jacobian = hand.position, hand.quaternion, hand.jacobian
    for k in range(4):
        total = 0.0
        for m in range(4):
            total += hand.turn[k, m] * hand.body_quaternion[i, hand.body, m]
        quaternion[i, k] = total
    # R(q) p = p + 2 w (v × p) + 2 v × (v × p)
    w, a, b, c = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
    px, py, pz = hand.tool[0], hand.tool[1], hand.tool[2]
    tx = 2.0 * (b * pz - c * py)
    ty = 2.0 * (c * px - a * pz)
    tz = 2.0 * (a * py - b * px)
    x = hand.site_position[i, hand.site, 0] + (px + w * tx + (b * tz - c * ty))
    y = hand.site_position[i, hand.site, 1] + (py + w * ty + (c * tx - a * tz))
    z = hand.site_position[i, hand.site, 2] + (pz + w * tz + (a * ty - b * tx))
    position[i, 0], position[i, 1], position[i, 2] = x, y, z
    for j in range(len(hand.joints)):
        joint = hand.joints[j]
        ux, uy, uz = hand.axis[i, joint, 0], hand.axis[i, joint, 1], hand.axis[i, joint, 2]
        dx, dy = x - hand.anchor[i, joint, 0], y - hand.anchor[i, joint, 1]
        dz = z - hand.anchor[i, joint, 2]
        jacobian[i, 0, j] = uy * dz - uz * dy
        jacobian[i, 1, j] = uz * dx - ux * dz
        jacobian[i, 2, j] = ux * dy - uy * dx
        jacobian[i, 3, j], jacobian[i, 4, j], jacobian[i, 5, j] = ux, uy, uz


@compiled
def follow_chain(i: int, chain: Chain, hand: Hand) -> None:
    """Write the arrays that `read_hand` reads, for simulation ``i`` at its angles, as MuJoCo does.

    The hand has one site and one body, number 0.
    """
    q, shift, turn, joint_shift, joint_axis, zero = chain
    anchor, axis = hand.anchor, hand.axis
    place, spin, moved = np.empty(3), np.empty(4), np.empty(3)
    own, turned = np.empty(4), np.empty(4)
    for k in range(3):
        place[k] = 0.0
    spin[0], spin[1], spin[2], spin[3] = 1.0, 0.0, 0.0, 0.0
    for j in range(q.shape[1] + 1):
        _rotate(spin, shift[j], moved)
        for k in range(3):
            place[k] += moved[k]
        _multiply(spin, turn[j], turned)
        for k in range(4):
            spin[k] = turned[k]
        if j == q.shape[1]:
            break
        _rotate(spin, joint_shift[j], moved)
        for k in range(3):
            anchor[i, j, k] = place[k] + moved[k]
        _rotate(spin, joint_axis[j], moved)
        for k in range(3):
            axis[i, j, k] = moved[k]
        half = 0.5 * (q[i, j] - zero[j])
        own[0] = np.cos(half)
        for k in range(3):
            own[1 + k] = np.sin(half) * joint_axis[j, k]
        _multiply(spin, own, turned)
        for k in range(4):
            spin[k] = turned[k]
        _rotate(spin, joint_shift[j], moved)
        for k in range(3):
            place[k] = anchor[i, j, k] - moved[k]
    for k in range(3):
        hand.site_position[i, 0, k] = place[k]
    for k in range(4):
        hand.body_quaternion[i, 0, k] = spin[k]


@compiled
def _rotate(q: Array, v: Array, out: Array) -> None:
    """Write v (3,) turned by a quaternion: v + 2 w (u × v) + 2 u × (u × v)."""
    w, a, b, c = q[0], q[1], q[2], q[3]
    x, y, z = 2.0 * (b * v[2] - c * v[1]), 2.0 * (c * v[0] - a * v[2]), 2.0 * (a * v[1] - b * v[0])
    out[0] = v[0] + w * x + (b * z - c * y)
    out[1] = v[1] + w * y + (c * x - a * z)
    out[2] = v[2] + w * z + (a * y - b * x)


@compiled
def _multiply(p: Array, q: Array, out: Array) -> None:
    """Write the product of quaternions p ⊗ q."""
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


@compiled
def _read_hands(hand: Hand) -> None:
    for i in range(len(hand.position)):
        read_hand(i, hand)


@compiled
def _follow_chains(chain: Chain, hand: Hand) -> None:
    for i in range(len(hand.position)):
        follow_chain(i, chain, hand)
        read_hand(i, hand)


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
        site = model.site(sticking.arm.end_effector).id
        kinematics = [batch.bind(name) for name in ("xanchor", "xaxis", "site_xpos", "xquat")]
        # numbered along the chain; an elastic joint's spring turns about the same axis
        joints = model.dof_jntid[sticking.motor].astype(np.int64)
        body = int(model.site_bodyid[site])
        self._set(sticking, kinematics, site, body, joints, tool)

    def _set(
        self,
        sticking: StickingModel,
        kinematics: list[Array],
        site: int,
        body: int,
        joints: Index,
        tool: ArrayLike,
    ) -> None:
        # q ⊗ site ⊗ hand as a matrix on q
        half, model = 0.5 * sticking.arm.hand_yaw, sticking.model
        turn = right_matrix(np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        turn = turn @ right_matrix(model.site_quat[model.site(sticking.arm.end_effector).id])
        nsim = len(kinematics[0])
        self.position = np.zeros((nsim, 3))
        """(N, 3) position of the tool point in the world [m]."""
        self.quaternion = np.zeros((nsim, 4))
        """(N, 4) orientation of the hand in the world, w, x, y, z."""
        self.jacobian = np.zeros((nsim, 6, sticking.n))
        """(N, 6, n) geometric Jacobian, translation above rotation [m/rad, 1]."""
        self.arrays = Hand(
            anchor=kinematics[0],
            axis=kinematics[1],
            site_position=kinematics[2],
            body_quaternion=kinematics[3],
            site=site,
            body=body,
            joints=joints,
            turn=turn,
            tool=np.array(tool, dtype=float),
            position=self.position,
            quaternion=self.quaternion,
            jacobian=self.jacobian,
        )
        """Arrays that compiled functions read and write; always the same objects."""

    def read(self) -> None:
        """Update the arrays from the present kinematics of all simulations."""
        _read_hands(self.arrays)


class MeasuredEndEffector(EndEffector):
    """The end effector at the angles that a controller has measured."""

    def __init__(self, sticking: StickingModel, angles: Array, tool: ArrayLike = (0, 0, 0)) -> None:
        """Make the end effectors at the live ``angles`` (N, n); see `EndEffector`."""
        nsim, n = angles.shape
        kinematics = [*np.zeros((2, nsim, n, 3)), np.zeros((nsim, 1, 3)), np.zeros((nsim, 1, 4))]
        self._set(sticking, kinematics, 0, 0, np.arange(n), tool)
        self.chain = Chain(angles, *_chain_of(sticking.arm.bare_model(), sticking.arm.end_effector))

    def read(self) -> None:
        """Update the arrays from the present angles."""
        _follow_chains(self.chain, self.arrays)


def _chain_of(model: mujoco.MjModel, site_name: str) -> tuple[Array, Array, Array, Array, Array]:
    """Return the chain of a serial arm for `follow_chain`; bodies without joints are merged."""
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
    """Return a tool point (3,) [m], the flange for None; raise unless it is 3 finite numbers."""
    point = (0.0, 0.0, 0.0) if tool is None else tool
    return checked_array(point, "tool", (3,), expected="three finite numbers, x y z in m")
