"""Frictionless arms under the impedance controller, for its tests."""

import functools
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from stiction_envs.control import rotation
from stiction_envs.control.impedance import (
    CartesianImpedance,
    ImpedanceSettings,
    impedance_cycle,
    read_flags,
    renew_space,
)
from stiction_envs.robots import load_arm

ROTOR = 0.1  # rotor inertia of every joint [kg·m²]


def from_rotation_vector(vector: ArrayLike) -> np.ndarray:
    """Quaternions (..., 4) of angle · axis (..., 3) [rad]."""
    return Rotation.from_rotvec(vector).as_quat(scalar_first=True)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle (...) of the rotation between quaternions (..., 4) [rad]."""
    return np.linalg.norm(rotation.rotation_error(a, b), axis=-1)


class Controllers(CartesianImpedance):
    """Controllers whose cycles are called from Python."""

    def torque(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        jacobian: np.ndarray,
        q: np.ndarray,
        dq: np.ndarray,
        dither: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """One cycle of all arms; return the command (N, n)."""
        added = np.broadcast_to(dither, self.command.shape).copy()
        for i in range(self.nsim):
            impedance_cycle(i, position, quaternion, jacobian, q, dq, added, self.arrays)
        return self.command.copy()

    def update_model(self, jacobian: np.ndarray, mass: np.ndarray) -> None:
        for i in range(self.nsim):
            self.arrays.null_active[i] = True
            assert renew_space(i, jacobian[i], mass[i], self.arrays)

    def set_reference(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        self.arrays.position[:], self.arrays.quaternion[:] = position, quaternion
        self.arrays.error_matrix[:] = rotation.error_matrix(quaternion)

    @property
    def flags(self) -> np.ndarray:
        """(3, N) singular, saturated, near a limit."""
        out = np.zeros((self.nsim, 3), dtype=bool)
        for i in range(self.nsim):
            read_flags(i, self.arrays, out[i])
        return out.T

    @property
    def error(self) -> np.ndarray:
        return self.arrays.state[:, :6].copy()

    @property
    def reference(self) -> tuple[np.ndarray, np.ndarray]:
        return self.arrays.position.copy(), self.arrays.quaternion.copy()

    @property
    def stiffness(self) -> np.ndarray:
        return -self.arrays.gain[:, :, :6]

    @property
    def damping(self) -> np.ndarray:
        return -self.arrays.gain[:, :, 6:]


class Rig:
    """One frictionless arm without gravity under its controller, in MuJoCo."""

    def __init__(self, robot: str = "panda", *, dt: float = 1e-3, **settings: object) -> None:
        self.arm = load_arm(robot)
        self.model = self.arm.model()
        self.model.opt.timestep = dt
        self.model.opt.gravity[:] = 0  # the robot's own gravity compensation, exact
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.model.dof_armature[:] = ROTOR
        self.data = mujoco.MjData(self.model)
        self.site = self.model.site(self.arm.end_effector).id
        given = ImpedanceSettings(**({"torque_rate": np.inf} | settings))
        self.control = Controllers(given, 1, self.arm.limits)
        self.put(self.arm.rest)

    def put(self, q: np.ndarray) -> None:
        """Rest at q with the reference there."""
        self.data.qpos[:], self.data.qvel[:] = q, 0
        pose = self.look()
        self.control.reset(np.arange(1), pose.position, pose.quaternion, pose.q)
        self.control.update_model(pose.jacobian, pose.mass)

    def look(self) -> "Look":
        m, d = self.model, self.data
        mujoco.mj_fwdPosition(m, d)
        jac, mass = np.zeros((1, 6, m.nv)), np.zeros((1, m.nv, m.nv))
        mujoco.mj_jacSite(m, d, jac[0, :3], jac[0, 3:], self.site)
        mujoco.mj_fullM(m, d, mass[0])
        turn = d.site_xmat[self.site].reshape(1, 3, 3)
        return Look(
            d.site_xpos[self.site][None].copy(),
            Rotation.from_matrix(turn).as_quat(scalar_first=True),
            jac,
            d.qpos[None].copy(),
            d.qvel[None].copy(),
            mass,
        )

    def step(self) -> "Look":
        """One control cycle and one step of physics."""
        pose = self.look()
        self.control.update_model(pose.jacobian, pose.mass)
        self.data.qfrc_applied[:] = self.control.torque(*pose[:5])[0]
        mujoco.mj_step(self.model, self.data)
        return pose


class Look(NamedTuple):
    """A controller's measurements of one arm, (1, …) each."""

    position: np.ndarray
    quaternion: np.ndarray
    jacobian: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    mass: np.ndarray


@functools.cache
def poses(n: int = 64) -> Look:
    """Random poses and speeds of one arm as a batch (n, …)."""
    rig, rng = Rig(), np.random.default_rng(0)
    low, high = (rig.arm.limits.position + np.array([0.1, -0.1])).T
    looks = []
    for _ in range(n):
        rig.data.qpos[:], rig.data.qvel[:] = rng.uniform(low, high), rng.normal(size=7)
        looks.append(rig.look())
    return Look(*map(np.concatenate, zip(*looks, strict=True)))


def batch(n: int = 64, **settings: object) -> tuple[Controllers, Look]:
    """Controllers of n arms, their references away from their poses."""
    look = poses(n)
    given = ImpedanceSettings(**({"torque_rate": np.inf} | settings))  # type: ignore[arg-type]
    control = Controllers(given, n, load_arm("panda").limits)
    rng = np.random.default_rng(1)
    q_d = look.q + 0.3 * np.random.default_rng(2).normal(size=(n, 7))
    control.reset(np.arange(n), look.position, look.quaternion, q_d)
    control.update_model(look.jacobian, look.mass)
    turn = from_rotation_vector(0.2 * rng.normal(size=(n, 3)))
    control.set_reference(
        look.position + 0.05 * rng.normal(size=(n, 3)), rotation.multiply(turn, look.quaternion)
    )
    return control, look
