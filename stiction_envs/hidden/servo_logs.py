"""Servo logs of simulated arms with hidden causes, every imperfection at once.

Each arm has its links off by 5 %, angles in steps of an encoder, stamps that are late, and a clock
that jitters; a hidden cause comes on top of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import unknown
from stiction_envs.friction.model import link_inertia
from stiction_envs.gap.causes.body.bodies import sphere, with_payload
from stiction_envs.gap.causes.body.payload import LEAST_INERTIA
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.parameters import INDEX, absent
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.hidden.imperfect_arms import scattered
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters

Array = NDArray[np.float64]
RATE_HZ = 50.0
"""Rows per second; assumed."""
ENCODER = 2 * np.pi / 4096
"""Step of the angle [rad], of common hobby servos; assumed."""
LATE = 2e-3
"""Time by which stamps are late [s]; assumed."""
JITTER = 2e-4
"""Standard deviation of the clock [s]; assumed."""
SAG = 0.04
"""Usual sag of an arm under its gravity [rad]: sets the servos' stiffness; assumed."""
BANDWIDTH = 30.0
"""Least natural frequency of a servo with its link [rad/s]; assumed."""
MOST_LOAD = 0.4
"""Largest friction over load [-]: gears that carry back; assumed."""
WEAKEST = 0.1
"""Least stiffness of a joint's servo over that of the strongest [-]; assumed."""
LAG = 0.05
"""Damping over stiffness [s], of an SO-101's servos 0.06 to 0.08 s; assumed."""
CAUSES = (
    "servo_stiffness",
    "damping",
    "delay",
    "armature",
    "coulomb_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "torque_limit",
    "speed_limit",
    "encoder_offset",
    "dead_zone",
    "payload",
)
"""Causes that can be hidden."""
OF_GRAVITY = {"servo_stiffness", "load_dependent_friction", "encoder_offset"}
"""Those that only joints under gravity show."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenServoLog:
    """A log, what its user knows, and what was hidden."""

    log: ServoLog
    stiffness: Array
    """(n,) of the servos as the user believes [N·m/rad]."""
    damping: Array
    """(n,) likewise [N·m·s/rad]."""
    hidden: tuple[tuple[str, int], ...]
    """Causes and their joints, from 1; 0 for a payload."""
    payload: tuple[float, float, float, float] | None = None
    """Hidden mass [kg] and centre of mass x, y, z in the flange frame [m]."""

    @property
    def servo(self) -> Servo:
        """What its user knows of the servos."""
        return Servo(stiffness=self.stiffness, damping=self.damping)

    @property
    def options(self) -> dict[str, list[float]]:
        """The same as options of `diagnose`."""
        return {
            "servo_stiffness": self.stiffness.tolist(),
            "servo_damping": self.damping.tolist(),
        }


def hide(
    arm: Arm,
    causes: Sequence[str],
    *,
    seed: int,
    seconds: float = 60.0,
    scatter: float = 0.05,
    start: Array | None = None,
    only_slow: bool = False,
) -> HiddenServoLog:
    """Simulate a servo log with hidden causes, each on a drawn joint.

    Args:
        arm: as its user models it.
        causes: names, of `CAUSES`.
        seed: of all draws.
        seconds: length of the log.
        scatter: of the links [-].
        start: (n,) middle of the motion [rad]; None for a bent pose.
        only_slow: whether all commands are slow waves.

    Raises:
        StictionError: an unknown cause.
    """
    for cause in causes:
        if cause not in CAUSES:
            raise unknown("cause", cause, CAUSES)
    rng = np.random.default_rng([seed, 11])
    n = arm.n
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    command = commands(arm, t, rng, start, only_slow=only_slow)
    plain = ServoLog(source="plan", t=t, q=command.copy(), dq=None, q_cmd=command)
    motions = joint_motions(arm, [plain])
    gravity = np.array([float(np.abs(m.gravity).max()) for m in motions])
    inertia = link_inertia(arm, command[:1])[0]
    stiffness = np.maximum(gravity / SAG, BANDWIDTH**2 * inertia)
    stiffness = np.maximum(stiffness, WEAKEST * stiffness.max())
    parameters = np.tile(absent(), (n, 1))
    parameters[:, INDEX["stiffness"]] = stiffness
    damping = stiffness * LAG
    parameters[:, INDEX["damping"]] = damping
    heavy = np.flatnonzero(gravity > 0.2 * gravity.max())
    hidden = []
    tool: tuple[float, float, float, float] | None = None
    for cause in causes:
        if cause == "payload":
            tool = _tool(arm, gravity)
            hidden.append((cause, 0))
            continue
        j = int(rng.choice(heavy if cause in OF_GRAVITY else np.arange(n)))
        _hide(parameters[j], cause, motions[j].gravity, command[:, j], t, inertia[j])
        hidden.append((cause, j + 1))
    real = with_inertias(arm, scattered(inertial_parameters(arm.pinocchio()), scatter, rng))
    if tool is not None:
        real = with_payload(real, sphere(tool[0], np.array(tool[1:])), LEAST_INERTIA)
    load = np.array([float(np.abs(m.gravity).mean()) for m in motions])
    angle = simulate_arm(real, [plain], parameters, load, threads=1)[0]
    late = np.stack([np.interp(t + LATE, t, angle[:, j]) for j in range(n)], axis=1)
    seen = np.round(late / ENCODER) * ENCODER
    log = ServoLog(
        source=f"hidden-{seed}.csv",
        t=t + np.clip(JITTER * rng.normal(size=len(t)), -3 * JITTER, 3 * JITTER),
        q=seen,
        dq=None,
        q_cmd=command,
    )
    return HiddenServoLog(
        log=log, stiffness=stiffness, damping=damping, hidden=tuple(hidden), payload=tool
    )


def _tool(arm: Arm, gravity: Array) -> tuple[float, float, float, float]:
    """Return a body at the flange whose gravity is a quarter of the arm's own; assumed.

    Args:
        arm: without it.
        gravity: (n,) largest gravity of each joint [N·m].
    """
    model = arm.model()
    reach = float(np.linalg.norm(model.body_pos[1:], axis=1).sum())
    return (0.25 * float(gravity.max()) / (9.81 * 0.7 * reach), 0.0, 0.01, 0.04)


def commands(
    arm: Arm,
    t: Array,
    rng: np.random.Generator,
    start: Array | None,
    *,
    only_slow: bool = False,
) -> Array:
    """Return (T, n) commands: slow waves, steps with rests between them, fast waves."""
    low, high = np.clip(arm.limits.position, -np.pi, np.pi).T
    middle = (low + high) / 2 + 0.15 * (high - low) if start is None else start
    span = np.minimum(0.25 * (high - low), 0.5)
    third = np.minimum((3 * t / t[-1]).astype(int), 2)
    out = np.empty((len(t), arm.n))
    for j in range(arm.n):
        slow = 0.6 * np.sin(2 * np.pi * rng.uniform(0.08, 0.15) * t + rng.uniform(0, 2 * np.pi))
        fast = 0.25 * np.sin(2 * np.pi * rng.uniform(0.7, 1.4) * t + rng.uniform(0, 2 * np.pi))
        level = rng.uniform(-1, 1, size=int(t[-1] / 2.0) + 2)
        held = level[(t / 2.0).astype(int)]
        part = slow if only_slow else np.choose(third, [slow, held, slow + fast])
        # a command does not jump further than a quarter of a second of slow motion
        out[:, j] = middle[j] + span[j] * _smooth(part, t)
    return out


def _smooth(x: Array, t: Array) -> Array:
    """Return x behind a first-order low-pass of 0.15 s (assumed)."""
    gain = 1.0 - np.exp(-(t[1] - t[0]) / 0.15)
    out = x.copy()
    for k in range(1, len(x)):
        out[k] = out[k - 1] + gain * (x[k] - out[k - 1])
    return out


def _hide(p: Array, cause: str, gravity: Array, command: Array, t: Array, inertia: float) -> None:
    """Change a joint's (P,) parameters; sizes are of what robots have, assumed."""
    stiffness = p[INDEX["stiffness"]]
    level = 0.02 * stiffness
    speed = float(np.percentile(np.abs(np.diff(command) / np.diff(t)), 98))
    if cause == "servo_stiffness":
        p[INDEX["stiffness"]] *= 0.6
    elif cause == "damping":
        p[INDEX["damping"]] *= 2.5
    elif cause == "delay":
        p[INDEX["delay"]] = 0.03
    elif cause == "armature":
        p[INDEX["armature"]] = 3.0 * inertia
    elif cause == "coulomb_friction":
        p[INDEX["stiction"]] = level
    elif cause == "stribeck_friction":
        p[INDEX["stiction"]], p[INDEX["drop"]] = 1.5 * level, 0.5
        p[INDEX["stribeck_velocity"]] = 0.05
    elif cause == "load_dependent_friction":
        p[INDEX["stiction"]] = max(p[INDEX["stiction"]], 0.3 * level)
        p[INDEX["load"]] = min(0.8 * level / float(np.abs(gravity).mean()), MOST_LOAD)
    elif cause == "torque_limit":
        needed = np.abs(gravity).max() + stiffness * 0.05
        p[INDEX["torque_limit"]] = 1.02 * float(needed)
    elif cause == "speed_limit":
        p[INDEX["speed_limit"]] = 0.6 * speed
    elif cause == "encoder_offset":
        p[INDEX["offset"]] = 0.15
    elif cause == "dead_zone":
        p[INDEX["dead_zone"]] = 0.02
