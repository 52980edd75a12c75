"""What is asked about each joint: what is known of its servo, what its motion could show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion, speeds
from stiction_envs.gap.servo.parameters import INDEX, LOW, absent
from stiction_envs.gap.servo.settings import ServoLimitSettings, ServoQuestionSettings
from stiction_envs.gap.servo.spread import LAG
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Servo:
    """What the simulation that is judged knows of the servos; (n,) each, or None."""

    stiffness: Array | None = None
    """[N·m/rad]."""
    damping: Array | None = None
    """[N·m·s/rad]."""
    same: bool = False
    """Whether all joints have the same servo."""
    parameters: Array | None = None
    """(n, P) of an earlier diagnosis; overrules the others."""
    arm: Arm | None = None
    """The arm whose file's friction and gravity compensation the simulation has; None for none."""

    @property
    def perfect(self) -> bool:
        """Whether nothing is known: the simulation that is judged follows its commands exactly."""
        return self.stiffness is None and self.parameters is None


def nominal_parameters(
    servo: Servo, motions: Sequence[JointMotion], settings: ServoQuestionSettings
) -> Array:
    """Return (n, P) parameters of the nominal simulation."""
    if servo.parameters is not None:
        return servo.parameters.copy()
    out = np.tile(absent(), (len(motions), 1))
    out[:, INDEX["stiffness"]] = (
        settings.unknown_stiffness if servo.stiffness is None else servo.stiffness
    )
    if servo.damping is not None:
        out[:, INDEX["damping"]] = servo.damping
    elif servo.stiffness is not None:
        inertia = np.array([float(m.inertia.mean()) for m in motions])
        out[:, INDEX["damping"]] = 2.0 * np.sqrt(servo.stiffness * inertia)
    if servo.arm is not None and not servo.perfect:
        _add_stated(out, servo.arm, motions, known=servo.damping is not None)
    return out


def _add_stated(out: Array, arm: Arm, motions: Sequence[JointMotion], *, known: bool) -> None:
    """Add to (n, P) parameters what the robot's file states; ``known``: the servos' damping is."""
    s = arm.stated
    out[:, INDEX["armature"]] = s.armature
    out[:, INDEX["damping"]] += known * s.damping
    if s.dry:
        stiction = np.maximum(s.stiction, LOW[INDEX["stiction"]])
        out[:, INDEX["stiction"]] = stiction
        out[:, INDEX["drop"]] = 1.0 - np.where(s.stiction > 0, s.coulomb / stiction, 1.0)
        bristle = s.bristle > 0
        out[bristle, INDEX["bristle"]] = stiction[bristle] / s.bristle[bristle]
        out[s.stribeck > 0, INDEX["stribeck_velocity"]] = s.stribeck[s.stribeck > 0]
    if s.gravcomp:
        some = [np.linspace(0, len(m.q) - 1, 100).astype(int) for m in motions]
        q = np.stack([m.q[rows] for m, rows in zip(motions, some, strict=True)], axis=1)
        carried = gravity_torque(arm.pinocchio(compensated=True), q)
        whole = gravity_torque(arm.pinocchio(), q)
        share = (carried * whole).sum(axis=0) / np.maximum(np.square(whole).sum(axis=0), 1e-12)
        out[:, INDEX["compensation"]] = share


def always_fitted(servo: Servo, scaled: bool) -> tuple[str, ...]:
    """Return what is fitted and no cause: links that are a little off, unknown damping."""
    if servo.perfect:
        return ()
    out = ["compensation"] if scaled else []
    if servo.damping is None and servo.parameters is None:
        out.append("damping")
    return tuple(out)


def possible_causes(
    servo: Servo,
    motion: JointMotion,
    resolution: float,
    scaled: bool,
    settings: ServoQuestionSettings,
) -> tuple[str, ...]:
    """Return the causes that a motion could show.

    Args:
        servo: what is known.
        motion: of the joint.
        resolution: step of its angle [rad].
        scaled: whether gravity scales its servo's torque.
        settings: what moves.
    """
    least = settings.moves * resolution
    if np.ptp(motion.command) < least or np.ptp(motion.q) < least:
        return ()
    out = ["servo_stiffness"] if scaled else []
    out += [*LAG, "coulomb_friction", "stribeck_friction", "presliding_hysteresis"]
    if scaled:
        out.append("load_dependent_friction")
        if not servo.perfect:
            out += ["encoder_offset", "gravity_compensation_missing"]
    out += ["torque_limit", "speed_limit", "dead_zone"]
    unknown = always_fitted(servo, scaled)
    return tuple(cause for cause in out if cause not in unknown)


def sags(
    motion: JointMotion,
    resolution: float,
    stiffness: float | None,
    settings: ServoQuestionSettings,
) -> bool:
    """Return whether gravity shows in a joint's sag, so that gravity scales the servo's torque.

    A servo of known stiffness [N·m/rad] shows gravity by a sag that is missing, too.
    """
    g, error = motion.gravity, motion.command - motion.q
    if np.abs(g).max() < settings.least_gravity:
        return False
    sag = float(error @ g) / float(g @ g) if stiffness is None else 1 / stiffness
    return bool(sag * np.sqrt(np.mean(g**2)) > settings.gravity_seen * resolution)


def resolution_of(q: Array) -> float:
    """Return the step of an encoder, or the smallest change that was logged [rad]."""
    steps = np.diff(np.unique(q))
    steps = steps[steps > 1e-9]
    return float(np.percentile(steps, 10)) if len(steps) else 1e-6


def rest_noise(motion: JointMotion, settings: ServoQuestionSettings) -> float:
    """Return the noise of the angle while the command rests [rad]."""
    still = np.concatenate([[False], np.diff(motion.command) == 0.0])
    calm = np.convolve(still, np.ones(settings.calm_rows), "same") >= settings.calm_rows
    jump = motion.q[1:-1] - 0.5 * (motion.q[:-2] + motion.q[2:])
    jump = jump[calm[1:-1]]
    return float(np.sqrt(np.mean(jump**2) / 1.5)) if len(jump) > settings.least_calm else 0.0


def shown(motion: JointMotion, resolution: float, settings: ServoQuestionSettings) -> Index:
    """Return (S,) how many rows of each segment show a joint's causes.

    The heads of all segments in which it moves, equally long: a limit shows in one motion, friction
    in another.
    """
    lengths = np.diff(motion.bounds)
    parts = [slice(a, b) for a, b in pairwise(motion.bounds)]
    moves = np.array(
        [np.ptp(motion.command[p]) >= settings.moves * resolution for p in parts], dtype=bool
    )
    lengths = np.where(moves, lengths, 0) if moves.any() else lengths
    most = settings.most_seconds / motion.step
    # the longest head of which all segments together have no more than that
    heads = np.sort(lengths)
    totals = np.cumsum(heads) + heads * np.arange(len(heads) - 1, -1, -1)
    if totals[-1] <= most:
        return lengths
    k = int(np.argmax(totals > most))
    head = int((most - heads[:k].sum()) / (len(heads) - k))
    return np.minimum(lengths, max(head, 1))


def lower_bounds(
    motion: JointMotion, part: JointMotion, stiffness: float, settings: ServoLimitSettings
) -> Array:
    """Return (P,) lower bounds: no limit lies below what was passed or needed most of the time.

    Args:
        motion: of the joint.
        part: of it, on which causes are chosen.
        stiffness: of its servo [N·m/rad].
        settings: what was passed.
    """
    low = LOW.copy()
    v, rows = speeds(motion, settings.passed_seconds), motion.rows_in(settings.passed_seconds)
    inside = (v[a + rows : b] for a, b in pairwise(motion.bounds) if b - a > rows)
    passed = max((float(np.percentile(x, settings.passed_percent)) for x in inside), default=0.0)
    low[INDEX["speed_limit"]] = max(low[INDEX["speed_limit"]], settings.passed * passed)
    stretched = float(np.percentile(np.abs(part.command - part.q), settings.often_percent))
    low[INDEX["torque_limit"]] = max(low[INDEX["torque_limit"]], stiffness * stretched)
    return low
