"""The thesis's identification (section 4.1) on simulated logs: lines of friction over speed.

    fit = fit_lines("panda", "gravity error")
    fit.lines[0].intercept

Equation 3.1 lays a straight line through friction torque against speed, per joint and direction,
all of it raw. Here the friction is known and one thing at a time is wrong with the log:
`WRONG` names them. `rosdyn` has the other method, the links by least squares.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from stiction_envs.gap.least_squares import Line, line
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.measured import thesis_base, thesis_robots
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.robots import Arm, load_arm
from stiction_envs.thesis.rosdyn import Unconstrained, rosdyn
from stiction_envs.thesis.settings import IdentificationSettings, thesis_settings

Array = NDArray[np.float64]
ALL_WRONG = "all of these"
WRONG: dict[str, Callable[[IdentificationSettings], dict[str, Any]]] = {
    "nothing": lambda s: {},
    "noisy acceleration": lambda s: {"noise": s.speed_noise},
    "gravity error": lambda s: {"hand": True},
    "no slow data": lambda s: {"fast": True},
    "filtered speeds that lag": lambda s: {"lag": s.speed_lag},
    ALL_WRONG: lambda s: {"noise": s.speed_noise, "hand": True, "fast": True, "lag": s.speed_lag},
}
"""What is wrong with a log: arguments of `simulated_log`."""
LINES, LINKS = thesis_robots("A.1"), thesis_robots("4.1")
"""The arm whose lines the thesis prints, and that whose links."""


def bands_of(robot: str) -> Array:
    """Return the stiction bands (n,) of an arm's joints [N·m]: means of Table 4.3.

    Raises:
        StictionError: an arm the thesis has not measured.
    """
    if robot in LINES:
        return np.array(thesis_settings().identification.bands)
    return np.asarray(np.abs(thesis_base(robot).tau).mean(axis=(1, 2)))


def friction(dq: Array, bands: Array) -> Array:
    """Return the true friction (T, n) [N·m]: band, Stribeck effect and viscous friction.

    Args:
        dq: (T, n) [rad/s].
        bands: (n,) stiction [N·m].
    """
    s = thesis_settings().identification
    drop = s.coulomb_ratio
    level = bands * (drop + (1 - drop) * np.exp(-np.square(dq / s.stribeck_velocity)))
    return np.asarray(np.tanh(dq / 1e-3) * level + s.viscous * bands * dq)


def simulated_log(
    robot: str = "panda",
    *,
    noise: float = 0.0,
    hand: bool = False,
    fast: bool = False,
    lag: float = 0.0,
    seed: int = 1,
) -> JointLog:
    """Return the log of an arm on Fourier trajectories.

    Args:
        robot: an arm of the thesis.
        noise: standard deviation of the logged speed [rad/s].
        hand: whether the arm carries a hand that its model does not know.
        fast: whether hardly a sample is slow.
        lag: time constant of a low-pass on the logged speed [s]; 0 is none.
        seed: of motion and noise.
    """
    s = thesis_settings().identification
    rng = np.random.default_rng(seed)
    arm = load_arm(robot, payload=s.hand if hand else None)
    t = np.arange(round(s.seconds * s.rate)) / s.rate
    q, dq, ddq = (np.zeros((len(t), arm.n)) for _ in range(3))
    for k in range(1, 5):
        w = 2 * np.pi * (s.fast_hz if fast else s.slow_hz) * k
        a, b = rng.normal(size=(2, arm.n)) / k
        sine, cosine = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q += a * sine + b * cosine
        dq += w * (a * cosine - b * sine)
        ddq -= w**2 * (a * sine + b * cosine)
    size = s.fast_speed / np.abs(dq).max(axis=0) if fast else s.slow_angle / np.abs(q).max(axis=0)
    q, dq, ddq = q * size + arm.rest, dq * size, ddq * size
    tau = inverse_dynamics(arm.pinocchio(), q, dq, ddq) + friction(dq, bands_of(robot))
    logged = dq + noise * rng.normal(size=dq.shape)
    if lag:
        k = np.exp(-1 / s.rate / lag)
        logged = lfilter([1 - k], [1, -k], logged, axis=0, zi=k * logged[:1])[0]
    tau = tau + s.torque_noise * rng.normal(size=tau.shape)
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "log.npz", t=t, q=q, dq=logged, tau=tau)
        return read_logs([Path(folder) / "log.npz"], arm.n, limits=arm.limits)[0]


def raw_friction(log: JointLog, arm: Arm, every: int = 1) -> tuple[Array, Array]:
    """Return speed and friction torque as the thesis had them, both (K, n) [rad/s, N·m].

    Measured torque less rigid-body dynamics; accelerations are differences of logged speeds.

    Args:
        log: the log.
        arm: as the model has it.
        every: of so many samples one.
    """
    dq = log.dq if log.dq is not None else np.gradient(log.q, log.t, axis=0)
    ddq = np.gradient(dq, log.t, axis=0)
    at = np.arange(2, len(log.t) - 2, every)
    rigid = inverse_dynamics(arm.pinocchio(), log.q[at], dq[at], ddq[at])
    return dq[at], log.tau[at] - rigid


def lines_of(speed: Array, torque: Array) -> tuple[Line, ...]:
    """Return the lines of equation 3.1, of every joint + before −.

    Args:
        speed: (K, n) [rad/s].
        torque: (K, n) friction torque [N·m].
    """
    out = []
    for j in range(speed.shape[1]):
        for direction, sign in (("+", 1.0), ("-", -1.0)):
            rows = sign * speed[:, j] > 0
            m, b, r2 = line(speed[rows, j], torque[rows, j])
            out.append(
                Line(
                    joint=j + 1,
                    direction=direction,
                    rows=int(rows.sum()),
                    intercept=b,
                    slope=m,
                    r2=r2,
                )
            )
    return tuple(out)


@dataclass(frozen=True, kw_only=True, eq=False)
class LineFit:
    """What the thesis's methods make of one simulated log."""

    robot: str
    wrong: str
    """Of `WRONG`."""
    speed: Array
    """(K, n) as logged [rad/s]."""
    torque: Array
    """(K, n) friction torque, raw [N·m]."""
    lines: tuple[Line, ...]
    links: Unconstrained | None
    """Links by RosDyn's least squares, of the arm of Table 4.1."""

    def of(self, joint: int, direction: str) -> Line:
        """Return a joint's line; joints from 1."""
        return next(x for x in self.lines if (x.joint, x.direction) == (joint, direction))


def fit_lines(robot: str, wrong: str, *, seed: int = 0) -> LineFit:
    """Return lines and links of a simulated log.

    Args:
        robot: an arm of the thesis.
        wrong: what is wrong with the log, of `WRONG`.
        seed: of motion and noise.
    """
    s = thesis_settings().identification
    arm = load_arm(robot)
    log = simulated_log(robot, seed=1 + seed, **WRONG[wrong](s))
    speed, torque = raw_friction(log, arm, s.every)
    return LineFit(
        robot=robot,
        wrong=wrong,
        speed=speed,
        torque=torque,
        lines=lines_of(speed, torque),
        links=rosdyn([log], arm) if robot in LINKS else None,
    )
