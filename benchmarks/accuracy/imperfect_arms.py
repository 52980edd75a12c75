"""Logs of excited arms whose links differ from the nominal; torques are MuJoCo's."""

import numpy as np

from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import from_pseudo_inertia, inertial_parameters, pseudo_inertia

COULOMB = np.array([0.5, 0.6, 0.4, 0.5, 0.3, 0.2, 0.25])
"""Dry friction of joints 1 to 7 [N·m]; assumed."""
VISCOUS = 0.3 * COULOMB  # [N·m·s/rad]; assumed
OFFSET = 0.1 * COULOMB  # constant torque [N·m]; assumed


def perturbed(arm: Arm, size: float, seed: int) -> Arm:
    """Return the arm with other physically consistent links: J → A J Aᵀ, A near identity."""
    phi = inertial_parameters(arm.pinocchio())
    j = pseudo_inertia(phi)
    root = np.linalg.cholesky(j)
    a = np.eye(4) + size * np.random.default_rng(seed).normal(size=j.shape)
    half = root @ a
    return with_inertias(arm, from_pseudo_inertia(half @ half.transpose(0, 2, 1)))


def presliding(q: np.ndarray, distance: float) -> np.ndarray:
    """Return dry friction over its level; it builds up over a ``distance`` [rad] per reversal."""
    out = np.zeros_like(q)
    for k in range(1, len(q)):
        way = q[k] - q[k - 1]
        out[k] = out[k - 1] + (np.sign(way) - out[k - 1]) * -np.expm1(-np.abs(way) / distance)
    return out


def log(
    true: Arm,
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    rate: float,
    *,
    noise: float,
    seed: int,
    angle_noise: float = 1e-5,
    presliding_distance: float = 2e-4,
) -> JointLog:
    """Return the log of a robot: friction on top, noise of torque [N·m] and angle [rad].

    ``presliding_distance`` [rad] is that of our engine's friction, which the fit assumes.
    """
    q, dq, ddq = state
    n = q.shape[1]
    rng = np.random.default_rng(seed)
    tau = inverse_torque(true.model(), q, dq, ddq)
    tau += COULOMB[:n] * presliding(q, presliding_distance) + VISCOUS[:n] * dq + OFFSET[:n]
    return JointLog(
        source="excited.csv",
        t=np.arange(len(q)) / rate,
        q=q + angle_noise * rng.normal(size=q.shape),
        dq=None,
        tau=tau + noise * rng.normal(size=q.shape),
    )


def truth(true: Arm) -> np.ndarray:
    """Return (10 n + 3 n,) parameters of links, Coulomb, viscous and offset."""
    n = true.n
    links = inertial_parameters(true.pinocchio()).ravel()
    return np.concatenate([links, COULOMB[:n], VISCOUS[:n], OFFSET[:n]])


def from_pose_to_pose(
    arm: Arm, reach: np.ndarray, seconds: float, rate: float, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rest-to-rest moves of 1.5 s to random poses within ``reach`` of the rest pose."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q = np.tile(arm.rest, (len(t), 1))
    dq, ddq = np.zeros_like(q), np.zeros_like(q)
    last = arm.rest
    for start in np.arange(0.3, seconds - 1.5, 1.8):
        goal = arm.rest + rng.uniform(-1, 1, arm.n) * reach
        x = np.clip((t - start) / 1.5, 0, 1)[:, None]
        q += (goal - last) * x**3 * (10 - 15 * x + 6 * x**2)
        dq += (goal - last) * 30 * x**2 * (1 - x) ** 2 / 1.5
        ddq += (goal - last) * 60 * x * (1 - x) * (1 - 2 * x) / 1.5**2
        last = goal
    return q, dq, ddq
