"""The thesis's identification (section 4.1) on simulated logs, and friction at constant speeds.

    fit = fit_lines("panda", "gravity error")
    fit.lines[1, "+"].intercept

Equation 3.1 lays a straight line through friction torque against speed, per joint and direction,
all of it raw. Here the friction is known and one thing at a time is wrong with the log: `WRONG`
names them. `rosdyn` has the other method, the links by least squares.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter
from scipy.stats import linregress

from benchmarks.thesis.rosdyn import Unconstrained, rosdyn
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.thesis_tables import thesis_base, thesis_robots
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
# the simulated logs; what has no source is assumed
RATE = 1000.0  # libfranka's [Hz]
SECONDS = 40.0  # the thesis does not say how long its trajectories are [s]
SLOW_HZ, SLOW_ANGLE = 0.05, 0.7  # lowest of four frequencies [Hz], largest angle from rest [rad]
FAST_HZ, FAST_SPEED = 0.4, 0.9  # of the motion without slow data; its largest speed [rad/s]
BANDS = (0.72, 1.0, 0.8, 0.95, 0.57, 0.44, 0.63)
"""Stiction bands of the Panda [N·m]: means of Table 4.3 without joint 2's outlier, rounded."""
COULOMB_RATIO = 0.7  # Coulomb friction over the band [-]
STRIBECK_VELOCITY = 0.05  # [rad/s]
VISCOUS = 0.4  # viscous friction over the band [s/rad]
TORQUE_NOISE = 0.05  # standard deviation of a logged torque [N·m]
SPEED_NOISE = 3e-3  # of a logged speed [rad/s]; a real Panda's: 4 mrad/s
SPEED_LAG = 0.05  # time constant of a filtered speed [s]; a real iiwa's: 56 ms
HAND = (0.73, 0.0, 0.0, 0.07)  # Franka hand [kg], assumed centre of mass [m]
EVERY = 4  # the lines are fitted to every so many samples: friction lasts for milliseconds
# the friction curve of Figure 2.3, assumed
SLOWEST, FASTEST, SPEEDS = 1e-3, 0.5, 16  # [rad/s]; evenly on a logarithmic scale, each direction
TRAVEL, LEAST_TIME = 6e-3, 1.0  # at each speed, at least: [rad], [s]
AVERAGED = 0.3  # share of the motion, at its end, over which the torque is averaged [-]
SERVO_HZ = 20.0  # natural frequency of the servo that moves the joint
ALL_WRONG = "all of these"
WRONG: dict[str, dict[str, Any]] = {
    "nothing": {},
    "noisy acceleration": {"noise": SPEED_NOISE},
    "gravity error": {"hand": True},
    "no slow data": {"fast": True},
    "filtered speeds that lag": {"lag": SPEED_LAG},
    ALL_WRONG: {"noise": SPEED_NOISE, "hand": True, "fast": True, "lag": SPEED_LAG},
}
"""What is wrong with a log: arguments of `simulated_log`."""
(PANDA,), (IIWA,) = thesis_robots("A.1"), thesis_robots("4.1")
"""The arm whose lines the thesis prints, and that whose links."""


def bands_of(robot: str) -> Array:
    """Return the stiction bands (n,) of an arm's joints [N·m]: means of Table 4.3.

    Raises:
        StictionError: an arm the thesis has not measured.
    """
    if robot == PANDA:
        return np.array(BANDS)
    return np.asarray(np.abs(thesis_base(robot).tau).mean(axis=(1, 2)))


def friction(dq: Array, bands: Array) -> Array:
    """Return the true friction (T, n) [N·m]: band, Stribeck effect and viscous friction.

    Args:
        dq: (T, n) [rad/s].
        bands: (n,) stiction [N·m].
    """
    peak = np.exp(-np.square(dq / STRIBECK_VELOCITY))
    level = bands * (COULOMB_RATIO + (1 - COULOMB_RATIO) * peak)
    return np.asarray(np.tanh(dq / 1e-3) * level + VISCOUS * bands * dq)


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
    rng = np.random.default_rng(seed)
    arm = load_arm(robot, payload=HAND if hand else None)
    t = np.arange(round(SECONDS * RATE)) / RATE
    q, dq, ddq = (np.zeros((len(t), arm.n)) for _ in range(3))
    for k in range(1, 5):
        w = 2 * np.pi * (FAST_HZ if fast else SLOW_HZ) * k
        a, b = rng.normal(size=(2, arm.n)) / k
        sine, cosine = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q += a * sine + b * cosine
        dq += w * (a * cosine - b * sine)
        ddq -= w**2 * (a * sine + b * cosine)
    size = FAST_SPEED / np.abs(dq).max(axis=0) if fast else SLOW_ANGLE / np.abs(q).max(axis=0)
    q, dq, ddq = q * size + arm.rest, dq * size, ddq * size
    tau = inverse_dynamics(arm.pinocchio(), q, dq, ddq) + friction(dq, bands_of(robot))
    logged = dq + noise * rng.normal(size=dq.shape)
    if lag:
        k = np.exp(-1 / RATE / lag)
        logged = lfilter([1 - k], [1, -k], logged, axis=0, zi=k * logged[:1])[0]
    tau = tau + TORQUE_NOISE * rng.normal(size=tau.shape)
    return JointLog(source="simulated", t=t, q=q, dq=logged, tau=tau)


def raw_friction(log: JointLog, arm: Arm) -> tuple[Array, Array]:
    """Return speed and friction torque as the thesis had them, both (K, n) [rad/s, N·m].

    Measured torque less rigid-body dynamics, of one sample in `EVERY`; accelerations are
    differences of logged speeds.
    """
    assert log.dq is not None
    ddq = np.gradient(log.dq, log.t, axis=0)
    at = np.arange(2, len(log.t) - 2, EVERY)
    rigid = inverse_dynamics(arm.pinocchio(), log.q[at], log.dq[at], ddq[at])
    return log.dq[at], log.tau[at] - rigid


class Line(NamedTuple):
    """One joint in one direction."""

    slope: float
    """m [N·m·s/rad]."""
    intercept: float
    """b [N·m]."""
    r2: float
    """Coefficient of determination [-]."""


def lines_of(speed: Array, torque: Array) -> dict[tuple[int, str], Line]:
    """Return the lines of equation 3.1, least squares, by joint (from 1) and direction, + before −.

    Args:
        speed: (K, n) [rad/s].
        torque: (K, n) friction torque [N·m].
    """
    out = {}
    for j in range(speed.shape[1]):
        for direction, rows in (("+", speed[:, j] > 0), ("-", speed[:, j] < 0)):
            fit = linregress(speed[rows, j], torque[rows, j])
            out[j + 1, direction] = Line(fit.slope, fit.intercept, fit.rvalue**2)
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class LineFit:
    """What the thesis's methods make of one simulated log."""

    robot: str
    speed: Array
    """(K, n) as logged [rad/s]."""
    torque: Array
    """(K, n) friction torque, raw [N·m]."""
    lines: dict[tuple[int, str], Line]
    """By joint (from 1) and direction."""
    links: Unconstrained | None
    """Links by RosDyn's least squares, of the arm of Table 4.1."""


def fit_lines(robot: str, wrong: str, *, seed: int = 0) -> LineFit:
    """Return lines and links of a simulated log.

    Args:
        robot: an arm of the thesis.
        wrong: what is wrong with the log, of `WRONG`.
        seed: of motion and noise.
    """
    arm = load_arm(robot)
    log = simulated_log(robot, seed=1 + seed, **WRONG[wrong])
    speed, torque = raw_friction(log, arm)
    return LineFit(
        robot=robot,
        speed=speed,
        torque=torque,
        lines=lines_of(speed, torque),
        links=rosdyn([log], arm) if robot == IIWA else None,
    )


# ---- friction at constant speeds -----------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionCurve:
    """Friction of joint 1 at constant speeds; levels by direction, + first.

    The first joint of both arms turns about the vertical and bears no weight: what its motor gives
    at a constant speed is friction.
    """

    robot: str
    stiction: Array
    """(2,) [N·m]."""
    coulomb: Array
    """(2,) [N·m]."""
    stribeck: Array
    """(2,) [rad/s]."""
    viscous: Array
    """(2,) [N·m·s/rad]."""
    speed: Array
    """(S,) simulated, ascending [rad/s]."""
    torque: Array
    """(S,) of the motor, signed as the speed [N·m]."""

    def law(self, speed: ArrayLike) -> Array:
        """Return the friction of the law at speeds [N·m], signed as they are."""
        v = np.asarray(speed, dtype=np.float64)
        k = (v < 0).astype(np.int64)
        peak = np.exp(-np.square(v / self.stribeck[k]))
        level = self.coulomb[k] + (self.stiction[k] - self.coulomb[k]) * peak
        return np.asarray(np.sign(v) * level + self.viscous[k] * v)


def friction_curve(robot: str, *, threads: int = 0) -> FrictionCurve:
    """Return law and simulated friction of an arm's first joint, without position ripple.

    Args:
        robot: the arm.
        threads: threads, 0 for all processors.
    """
    sticking = sticking_model(robot)
    arm, none = sticking.arm, np.zeros(sticking.arm.n)
    p = sticking.parameters.replace(offset=none, gravity_error=none, ripple_amplitude=none)
    one = np.geomspace(SLOWEST, FASTEST, SPEEDS)
    speed = np.concatenate([-one[::-1], one])
    plant = Plant(sticking, len(speed), parameters=p, threads=threads)
    # heavy joints and light ones alike: a servo of one frequency, critically damped
    inertia = link_inertia(arm, arm.rest[None])[0] + p.rotor_inertia
    omega = 2 * np.pi * SERVO_HZ
    stiffness, damping = omega**2 * inertia, 2 * omega * inertia
    plant.set_servo(np.arange(len(speed)), stiffness, damping, arm.rest)
    duration = np.maximum(TRAVEL / np.abs(speed), LEAST_TIME)
    steps = np.rint(duration / CONTROL_DT).astype(int)
    longest = int(steps.max())
    setpoint = np.broadcast_to(arm.rest, (len(speed), longest, arm.n)).copy()
    time = (np.arange(longest) + 1) * CONTROL_DT
    setpoint[:, :, 0] += speed[:, None] * np.minimum(time, steps[:, None] * CONTROL_DT)
    angle = plant.run(np.zeros((len(speed), longest, arm.n)), setpoint=setpoint)[:, :, 0]
    torque = np.empty(len(speed))
    for k, end in enumerate(steps):
        now = np.arange(int(end - AVERAGED * end), int(end))
        # the servo acts on the angle at the start of the step
        lag = float(np.mean(setpoint[k, now, 0] - angle[k, now - 1]))
        torque[k] = stiffness[0] * lag - damping[0] * speed[k]
    level = p.stiction_at(plant.load[1][0])[0]
    return FrictionCurve(
        robot=robot,
        stiction=level,
        coulomb=level * p.coulomb_ratio[0],
        stribeck=p.stribeck_velocity[0],
        viscous=p.viscous[0],
        speed=speed,
        torque=torque,
    )
