"""Logs as somebody else would write them: MuJoCo's inverse dynamics, a formula, white noise.

The second generator of the blind tests. Nothing here comes from the package but the arms' MJCF:
angles, speeds and accelerations are analytic, the torque is ``mj_inverse`` of the nominal arm, and
the effect is the textbook's formula.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
CENTRE = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.9, 0.5])
MIDDLE = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 1.0, 0.0])
"""A pose in the middle of the Panda's ranges, and of the iiwas'."""


def fourier(
    rng: np.random.Generator, t: Array, centre: Array, base: float = 0.1, harmonics: int = 5
) -> tuple[Array, Array, Array]:
    """Angles, speeds and accelerations of a Fourier series of all joints, (T, n) each."""
    k = 2 * np.pi * base * np.arange(1, harmonics + 1)
    a, b = (
        rng.normal(size=(2, harmonics, len(centre))) / np.sqrt(np.arange(1, harmonics + 1))[:, None]
    )
    s, c = np.sin(np.outer(t, k)), np.cos(np.outer(t, k))
    q = s @ (a / k[:, None]) - c @ (b / k[:, None])
    size = 0.8 / np.abs(q).max(axis=0)
    v, acc = c @ a + s @ b, c @ (b * k[:, None]) - s @ (a * k[:, None])
    return centre + q * size, v * size, acc * size


def inverse(
    robot: str,
    q: Array,
    dq: Array,
    ddq: Array,
    *,
    payload: tuple[float, Array] | None = None,
    tilt: tuple[float, float] = (0.0, 0.0),
    link: tuple[int, float, Array] | None = None,
) -> Array:
    """(T, n) torque of the arm, of a sphere at its flange, on a base that leans.

    A link (from 1) may have another mass [kg] and centre [m], each as a difference; its density
    changes evenly.
    """
    spec = load_arm(robot).spec()
    if link is not None:
        body = list(spec.joints)[link[0] - 1].parent
        share = 1 + link[1] / body.mass
        body.fullinertia, body.inertia = body.fullinertia * share, body.inertia * share
        body.mass, body.ipos = body.mass * share, body.ipos + link[2]
    lean, towards = tilt
    side = np.sin(lean) * np.array([np.cos(towards), np.sin(towards)])
    spec.option.gravity = 9.81 * np.array([*side, -np.cos(lean)])
    if payload is not None:
        site = next(x for x in spec.sites if x.name == "flange")
        load = site.parent.add_body(name="load", pos=site.pos, quat=site.quat)
        load.mass, load.ipos = payload
        load.inertia = [0.4 * payload[0] * 0.03**2] * 3
        load.explicitinertial = True
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model = spec.compile()
    model.dof_armature[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    out = np.empty_like(q)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], dq[i], ddq[i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse
    return out


def believed(cause: str | None, robot: str, size: float = 1.0) -> Arm:
    """The arm that a log is held against: with a hand of 0.7 kg where that is what is wrong."""
    hand = (0.7 * size, -0.01, 0.0, 0.03) if cause == "phantom_payload" else None
    return load_arm(robot, payload=hand)


def dahl(q: Array, level: float, stiffness: float) -> Array:
    """(T,) torque of a bristle that starts unloaded."""
    out = np.zeros(len(q))
    for i, way in enumerate(np.diff(q)):
        keep = np.exp(-abs(way) * stiffness / level)
        out[i + 1] = out[i] * keep + np.sign(way) * level * (1 - keep)
    return out


def plain_log(
    cause: str | None,
    *,
    robot: str = "panda",
    joints: tuple[int, ...] = (4,),
    size: float = 1.0,
    noise: float = 0.05,
    rate: float = 500.0,
    seconds: float = 20.0,
    seed: int = 0,
    base: float = 0.1,
    angle_noise: float = 0.0,
    with_speed: bool = False,
    centre: Array | None = None,
) -> JointLog:
    """One log with one cause, or none.

    Args:
        cause: of the contract's table; ``phantom_payload`` is only in what is `believed`.
        robot: a built-in arm.
        joints: from 1, where it acts, or the link.
        size: of the effect, 1 being about 1 N·m.
        noise: of the torque, white [N·m].
        rate: rows per second.
        seconds: length.
        seed: of motion and noise.
        base: lowest frequency of the motion [Hz].
        angle_noise: white [rad].
        with_speed: whether ``dq`` is logged.
        centre: (7,) of the motion [rad].
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / rate)
    middle = CENTRE if robot == "panda" else MIDDLE
    q, v, a = fourier(rng, t, middle if centre is None else centre, base)
    load, late, link = None, 0.0, None
    if cause == "link_parameters":
        link = (joints[0], 0.5 * size, np.array([0.005, -0.005, 0.003]) * size)
    tilt = (0.05 * size, 0.7) if cause == "base_tilt" else (0.0, 0.0)
    if cause == "payload":
        load = (size, np.array([0.02, 0.0, 0.05]))
    if cause == "actuator_delay":
        late = 0.01 * size
    shifted = t + late
    if late:
        q2, v2, a2 = fourier(
            np.random.default_rng(seed), shifted, middle if centre is None else centre, base
        )
        tau = inverse(robot, q2, v2, a2)
    else:
        tau = inverse(robot, q, v, a, payload=load, tilt=tilt, link=link)
    rigid = tau.copy()
    for j in (x - 1 for x in joints):
        tau[:, j] += _effect(cause, q[:, j], v[:, j], a[:, j], rigid[:, j], t, size)
    if cause == "joint_elasticity":
        bent = q.copy()
        for j in (x - 1 for x in joints):
            bent[:, j] -= rigid[:, j] * size / 2000.0
        dt = 1 / rate
        speed = np.gradient(bent - q, dt, axis=0)
        tau = inverse(robot, bent, v + speed, a + np.gradient(speed, dt, axis=0))
    q = q + angle_noise * rng.normal(size=q.shape)
    return JointLog(
        source=f"plain_{cause}.csv",
        t=t,
        q=q,
        dq=v if with_speed else None,
        tau=tau + noise * rng.normal(size=q.shape),
    )


def _effect(
    cause: str | None, q: Array, v: Array, a: Array, rigid: Array, t: Array, size: float
) -> Array:
    sign = np.sign(v)
    match cause:
        case "coulomb_friction":
            return size * sign
        case "viscous_friction":
            return size * v
        case "stribeck_friction":
            return sign * size * (1 + np.exp(-((v / 0.1) ** 2)))
        case "stribeck_alone":
            return sign * size * np.exp(-((v / 0.1) ** 2))
        case "direction_asymmetry":
            return np.where(v > 0, 1.4 * size, -0.6 * size)
        case "load_dependent_friction":
            return sign * (0.5 + 0.1 * np.abs(rigid)) * size
        case "load_alone":
            return sign * 0.1 * np.abs(rigid) * size
        case "presliding_hysteresis":
            return dahl(q, size, size / 0.02)
        case "position_dependent_friction":
            return size * np.sin(20 * q + 0.4)
        case "ripple_of_friction":
            return size * (1 + 0.5 * np.sin(20 * q + 0.4)) * sign
        case "warm_up_drift":
            return sign * size * (1 - 0.02 * t)
        case "warm_up_exponential":
            return sign * size * (1 + 0.6 * np.exp(-t / 8))
        case "torque_offset":
            return np.full_like(q, size)
        case "torque_scale":
            return 0.1 * size * rigid
        case "link_inertia":
            return 0.4 * size * a
        case "smooth_waves":
            return size * (np.cos(q + 0.3) - 0.5 * np.sin(2 * q))
        case "smooth_hump":
            return size * np.exp(-0.5 * ((q - q.mean()) / 0.35) ** 2)
        case "external_spring":
            return 3 * size * (q - 0.2)
        case "backlash":
            return _gap(q, v, rigid, 0.02 * size)
    return np.zeros_like(q)


def _gap(q: Array, v: Array, rigid: Array, gap: float) -> Array:
    """Minus the load while the motor crosses the gap after each reversal."""
    out, start = np.zeros_like(q), None
    for i in range(1, len(q)):
        if v[i] * v[i - 1] < 0:
            start = q[i]
        if start is not None and abs(q[i] - start) < gap:
            out[i] = -rigid[i]
    return out
