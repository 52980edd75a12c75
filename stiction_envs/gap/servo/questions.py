"""What is asked about each joint: what is known of its servo, what its motion could show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.choose import LAG
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import INDEX, absent

Array = NDArray[np.float64]
MOST_SECONDS = 240.0
"""Time of the logs on which causes are chosen [s]; segments beyond it only refine; assumed."""
GRAVITY_SEEN = 3.0
"""Least sag of a joint by gravity over the angle's resolution that scales its servo's stiffness
[-]; assumed."""
LEAST_GRAVITY = 0.02
"""Largest gravity of a joint that counts as one without [N·m], as of `friction.model`; assumed."""
MOVES = 5.0
"""Least range of a joint's command over the resolution for it to be diagnosed [-]; assumed."""
PLACEHOLDER = 10.0
"""Stiffness of a servo of which nothing is known [N·m/rad]; assumed, and said."""


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

    @property
    def perfect(self) -> bool:
        """Whether nothing is known: the simulation that is judged follows its commands exactly."""
        return self.stiffness is None and self.parameters is None


def nominal_parameters(servo: Servo, motions: Sequence[JointMotion]) -> Array:
    """Return (n, P) parameters of the nominal simulation."""
    if servo.parameters is not None:
        return servo.parameters.copy()
    out = np.tile(absent(), (len(motions), 1))
    out[:, INDEX["stiffness"]] = PLACEHOLDER if servo.stiffness is None else servo.stiffness
    if servo.damping is not None:
        out[:, INDEX["damping"]] = servo.damping
    elif servo.stiffness is not None:
        inertia = np.array([float(m.inertia.mean()) for m in motions])
        out[:, INDEX["damping"]] = 2.0 * np.sqrt(servo.stiffness * inertia)
    return out


def always_fitted(servo: Servo, scaled: bool) -> tuple[str, ...]:
    """Return what is fitted and no cause: links that are a little off, damping nobody said."""
    if servo.perfect:
        return ()
    out = ["compensation"] if scaled else []
    if servo.damping is None and servo.parameters is None:
        out.append("damping")
    return tuple(out)


def possible_causes(
    servo: Servo, motion: JointMotion, resolution: float, scaled: bool
) -> tuple[str, ...]:
    """Return the causes that a motion could show.

    Args:
        servo: what is known.
        motion: of the joint.
        resolution: step of its angle [rad].
        scaled: whether gravity scales its servo's torque.
    """
    if np.ptp(motion.command) < MOVES * resolution or np.ptp(motion.q) < MOVES * resolution:
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


def sags(motion: JointMotion, resolution: float) -> bool:
    """Return whether the joint sags with gravity, so that gravity scales the servo's torque."""
    g, error = motion.gravity, motion.command - motion.q
    if np.abs(g).max() < LEAST_GRAVITY:
        return False
    sag = float(error @ g) / float(g @ g)
    return bool(sag * np.sqrt(np.mean(g**2)) > GRAVITY_SEEN * resolution)


def resolution_of(q: Array) -> float:
    """Return the step of an encoder, or the smallest change that was logged [rad]."""
    steps = np.diff(np.unique(q))
    steps = steps[steps > 1e-9]
    return float(np.percentile(steps, 10)) if len(steps) else 1e-6


def rest_noise(motion: JointMotion) -> float:
    """Return the noise of the angle while the command rests [rad]."""
    still = np.concatenate([[False], np.diff(motion.command) == 0.0])
    calm = np.convolve(still, np.ones(9), "same") >= 9
    jump = motion.q[1:-1] - 0.5 * (motion.q[:-2] + motion.q[2:])
    jump = jump[calm[1:-1]]
    return float(np.sqrt(np.mean(jump**2) / 1.5)) if len(jump) > 20 else 0.0


def busiest(motion: JointMotion) -> NDArray[np.bool_]:
    """Return (S,) the segments on which a joint's causes are chosen: where it moves most."""
    parts = [slice(a, b) for a, b in pairwise(motion.bounds)]
    seconds = np.array([float(np.ptp(motion.t[p])) for p in parts])
    path = np.array([float(np.abs(np.diff(motion.command[p])).sum()) for p in parts])
    order = np.argsort(-path / np.maximum(seconds, 1e-9), kind="stable")
    keep = np.zeros(len(seconds), dtype=bool)
    keep[order[0]] = True
    keep[order[np.cumsum(seconds[order]) <= MOST_SECONDS]] = True
    return keep
