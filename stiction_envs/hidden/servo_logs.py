"""Servo logs of simulated arms with hidden causes, every imperfection at once.

Each arm has its links off by 5 %, angles in steps of an encoder, stamps that are late, and a clock
that jitters; a hidden cause comes on top of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from stiction_envs.arrays import Array
from stiction_envs.errors import unknown
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_parameters import INDEX, absent
from stiction_envs.hidden.servo_effects import EFFECTS, ServoJoint
from stiction_envs.hidden.servo_simulation import simulate, weightless, weights
from stiction_envs.hidden.worlds import with_scattered_links
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

RATE_HZ = 50.0  # rows per second; assumed
ENCODER = 2 * np.pi / 4096  # step of the angle [rad], of common hobby servos; assumed
LATE = 2e-3  # time by which stamps are late [s]; assumed
JITTER = 2e-4  # standard deviation of the clock [s]; assumed
SAG = 0.04  # usual sag of an arm under its gravity [rad]: sets the servos' stiffness; assumed
BANDWIDTH = 30.0  # least natural frequency of a servo with its link [rad/s]; assumed
WEAKEST = 0.1  # least stiffness of a joint's servo over that of the strongest [-]; assumed
LAG = 0.05  # damping over stiffness [s], of an SO-101's servos 0.06 to 0.08 s; assumed
TOOL = 0.25  # largest gravity of a hidden payload over the arm's own [-], about; assumed
CAUSES = (*(name for name, effect in EFFECTS.items() if effect.usual is not None), "payload")


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
        """Stiffness and damping that the user believes."""
        return Servo(stiffness=self.stiffness, damping=self.damping)

    @property
    def options(self) -> dict[str, list[float]]:
        """Stiffness and damping as options of `diagnose`."""
        return {"servo_stiffness": self.stiffness.tolist(), "servo_damping": self.damping.tolist()}


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
    """Simulate a servo log with hidden ``causes``, each on a drawn joint.

    Args:
        arm: as its user models it.
        causes: names, of `CAUSES`.
        seed: of all draws.
        seconds: length of the log.
        scatter: of the links [-].
        start: (n,) middle of the motion [rad]; None for a bent pose.
        only_slow: whether all commands are slow waves.
    """
    for cause in causes:
        if cause not in CAUSES:
            raise unknown("cause", cause, CAUSES)
    rng = np.random.default_rng([seed, 11])
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    command = commands(arm, t, rng, start, only_slow=only_slow)
    gravity = np.abs(weights(*weightless(arm), command)).max(axis=0)
    inertia = link_inertia(arm, command[:1])[0]
    stiffness = np.maximum(gravity / SAG, BANDWIDTH**2 * inertia)
    stiffness = np.maximum(stiffness, WEAKEST * stiffness.max())
    damping = stiffness * LAG
    parameters = np.tile(absent(), (arm.n, 1))
    parameters[:, INDEX["stiffness"]], parameters[:, INDEX["damping"]] = stiffness, damping
    speed = np.percentile(np.abs(np.diff(command, axis=0)) * RATE_HZ, 98, axis=0)
    heavy = np.flatnonzero(gravity > 0.2 * gravity.max())
    hidden = []
    tool: tuple[float, float, float, float] | None = None
    for cause in causes:
        effect = EFFECTS[cause]
        if effect.usual is None:
            reach = float(np.linalg.norm(arm.model().body_pos[1:], axis=1).sum())
            tool = (TOOL * float(gravity.max()) / (9.81 * 0.7 * reach), 0.0, 0.01, 0.04)
            hidden.append((cause, 0))
            continue
        j = int(rng.choice(heavy if effect.under_gravity else np.arange(arm.n)))
        joint = ServoJoint(
            parameters=parameters[j],
            friction=effect.dry * stiffness[j],
            gravity=gravity[j],
            torque=gravity[j] + stiffness[j] * 0.05,
            speed=speed[j],
            inertia=inertia[j],
        )
        parameters[j] = effect.changed(joint, effect.usual(joint))
        hidden.append((cause, j + 1))
    real = with_scattered_links(arm, scatter, rng)
    angle = simulate(real, parameters, t, command, command[0], tool)
    late = np.stack([np.interp(t + LATE, t, x) for x in angle.T], axis=1)
    log = ServoLog(
        source=f"hidden-{seed}.csv",
        t=t + np.clip(JITTER * rng.normal(size=len(t)), -3 * JITTER, 3 * JITTER),
        q=np.round(late / ENCODER) * ENCODER,
        dq=None,
        q_cmd=command,
    )
    return HiddenServoLog(
        log=log, stiffness=stiffness, damping=damping, hidden=tuple(hidden), payload=tool
    )


def commands(
    arm: Arm, t: Array, rng: np.random.Generator, start: Array | None, *, only_slow: bool = False
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
        # a command does not jump: it comes through a first-order low-pass of 0.15 s (assumed)
        gain = 1.0 - np.exp(-(t[1] - t[0]) / 0.15)
        smooth, _ = lfilter([gain], [1.0, gain - 1.0], part, zi=[(1.0 - gain) * part[0]])
        out[:, j] = middle[j] + span[j] * smooth
    return out
