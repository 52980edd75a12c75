"""What is asked about each joint: what is known of its servo, what its motion could show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion, speeds
from stiction_envs.gap.servo.parameters import INDEX, LOW, absent
from stiction_envs.gap.servo.spread import LAG
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MOST_SECONDS = 240.0
"""Time of the logs on which causes are chosen [s]; segments beyond it only refine; assumed."""
GRAVITY_SEEN = 3.0
"""Least sag of a joint by gravity over the angle's resolution that scales its servo's stiffness
[-]; assumed."""
LEAST_GRAVITY = 0.02
"""Largest gravity of a joint that counts as one without [N·m], as of `friction.model`; assumed."""
CALM_ROWS = 9
"""Rows for which a command rests where the angle's noise is taken; assumed."""
LEAST_CALM = 20
"""Least rows that show it; assumed."""
MOVES = 5.0
"""Least range of a joint's command over the resolution for it to be diagnosed [-]; assumed."""
UNKNOWN_STIFFNESS = 10.0
"""Stiffness of a servo of which nothing is known [N·m/rad]; the notes say so; assumed."""
PASSED_SECONDS = 0.1
"""Time over which a speed counts as passed [s]; assumed."""
PASSED_PERCENT = 99.0
"""Percentile of such speeds that counts as the largest [%]; assumed."""
PASSED = 0.9
"""Least speed limit over the largest speed that was passed [-]; assumed."""
OFTEN_PERCENT = 85.0
"""Percentile of the distance from the command that no torque limit lies below [%]; assumed."""


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


def nominal_parameters(servo: Servo, motions: Sequence[JointMotion]) -> Array:
    """Return (n, P) parameters of the nominal simulation."""
    if servo.parameters is not None:
        return servo.parameters.copy()
    out = np.tile(absent(), (len(motions), 1))
    known = servo.stiffness
    out[:, INDEX["stiffness"]] = UNKNOWN_STIFFNESS if known is None else known
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
) -> tuple[str, ...]:
    """Return the causes that a motion could show.

    Args:
        servo: what is known.
        motion: of the joint.
        resolution: step of its angle [rad].
        scaled: whether gravity scales its servo's torque.
    """
    least = MOVES * resolution
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


def sags(motion: JointMotion, resolution: float, stiffness: float | None) -> bool:
    """Return whether gravity shows in a joint's sag, so that gravity scales the servo's torque.

    A servo of known stiffness [N·m/rad] shows gravity by a sag that is missing, too.
    """
    g, error = motion.gravity, motion.command - motion.q
    if np.abs(g).max() < LEAST_GRAVITY:
        return False
    sag = float(error @ g) / float(g @ g) if stiffness is None else 1 / stiffness
    return bool(sag * np.sqrt(np.mean(g**2)) > GRAVITY_SEEN * resolution)


def resolution_of(q: Array) -> float:
    """Return the step of an encoder, or the smallest change that was logged [rad]."""
    steps = np.diff(np.unique(q))
    steps = steps[steps > 1e-9]
    return float(np.percentile(steps, 10)) if len(steps) else 1e-6


def rest_noise(motion: JointMotion) -> float:
    """Return the noise of the angle while the command rests [rad]."""
    still = np.concatenate([[False], np.diff(motion.command) == 0.0])
    calm = np.convolve(still, np.ones(CALM_ROWS), "same") >= CALM_ROWS
    jump = motion.q[1:-1] - 0.5 * (motion.q[:-2] + motion.q[2:])
    jump = jump[calm[1:-1]]
    return float(np.sqrt(np.mean(jump**2) / 1.5)) if len(jump) > LEAST_CALM else 0.0


def shown(motion: JointMotion, resolution: float) -> Index:
    """Return (S,) how many rows of each segment show a joint's causes.

    The heads of all segments in which it moves, equally long: a limit shows in one motion, friction
    in another.
    """
    lengths = np.diff(motion.bounds)
    parts = [slice(a, b) for a, b in pairwise(motion.bounds)]
    moves = np.array([np.ptp(motion.command[p]) >= MOVES * resolution for p in parts], dtype=bool)
    lengths = np.where(moves, lengths, 0) if moves.any() else lengths
    most = MOST_SECONDS / motion.step
    # the longest head of which all segments together have no more than that
    heads = np.sort(lengths)
    totals = np.cumsum(heads) + heads * np.arange(len(heads) - 1, -1, -1)
    if totals[-1] <= most:
        return lengths
    k = int(np.argmax(totals > most))
    head = int((most - heads[:k].sum()) / (len(heads) - k))
    return np.minimum(lengths, max(head, 1))


def lower_bounds(motion: JointMotion, part: JointMotion, stiffness: float) -> Array:
    """Return (P,) lower bounds: no limit lies below what was passed or needed most of the time.

    Args:
        motion: of the joint.
        part: of it, on which causes are chosen.
        stiffness: of its servo [N·m/rad].
    """
    low = LOW.copy()
    v, rows = speeds(motion, PASSED_SECONDS), motion.rows_in(PASSED_SECONDS)
    inside = (v[a + rows : b] for a, b in pairwise(motion.bounds) if b - a > rows)
    passed = max((float(np.percentile(x, PASSED_PERCENT)) for x in inside), default=0.0)
    low[INDEX["speed_limit"]] = max(low[INDEX["speed_limit"]], PASSED * passed)
    stretched = float(np.percentile(np.abs(part.command - part.q), OFTEN_PERCENT))
    low[INDEX["torque_limit"]] = max(low[INDEX["torque_limit"]], stiffness * stretched)
    return low
