"""Questions about each joint: knowledge of its servo, causes that its motion could show, notes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array, Bools, Index, rms
from stiction_envs.gap.servo.causes import causes_of_joints, servo_cause
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.servo_parameters import INDEX, LOW, InServo, absent
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

MOST_SECONDS = 240.0
"""Time of the logs on which causes are chosen [s]; segments beyond it only refine; assumed."""
GRAVITY_SEEN = 3.0
"""Least sag by gravity over the angle's resolution that scales a servo's stiffness [-]; assumed."""
LEAST_GRAVITY = 0.02
"""Largest gravity of a joint that counts as one without, over the arm's largest [-]; assumed."""
LINK_MASSES, LINK_CENTRES, LINK_INERTIAS = 0.07, 0.007, 0.1
"""Usual error of the links' masses [-], centres [m], and of a joint's inertia [-]; assumed."""
STAMPS = 3e-3
"""Usual error of a log's stamps [s]; assumed."""
SERVO_OFF = 0.05
"""Usual error of a servo's stated stiffness and damping [-]; assumed."""
LEFT = 0.02
"""Part of a servo's torque that no model has, but for that of gravity, whose small errors are in
every model [-]; assumed."""
BRISTLES = 0.5
"""Usual error of the logarithm of a bristle's stiffness, which no data sheet has [-]; assumed."""
CALM_ROWS, LEAST_CALM = 9, 20
"""Rows for which a command rests where noise is measured, and their least number; assumed."""
MOVES = 5.0
"""Least range of a joint's command over the resolution for it to be diagnosed [-]; assumed."""
PASSED = 3
"""Number of rows that show that a speed was passed; assumed."""
UNKNOWN_STIFFNESS, UNKNOWN_BANDWIDTH = 10.0, 50.0
"""Least stiffness over the arm's largest gravity [1/rad] and natural frequency [rad/s] of a servo
of which nothing is known: where its fit starts. Assumed."""
UNKNOWN_OFF = 1.2
"""Usual error of the logarithm of that stiffness [-]; assumed: a factor of three."""
SETTLED = 1.0
"""Time for which a command rests before its joint counts as settled [s]; assumed."""
SWINGS = 0.5
"""Least swing of a settled joint over its error, and least part of the swing that a model leaves
[-]; assumed."""

EARLY = 0.025
"""Time by which a command comes after the motion that is more than late stamps [s]; assumed: the
angles of a bus of six servos are 20 ms younger than their stamps."""
AHEAD = np.arange(0.0, 0.2, 0.002)
"""Times by which a command may come after the motion, tried in turn [s]; assumed."""
EARLY_LEAVES = 0.25
"""Most that such a time leaves of a joint's squared distance from its command [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Servo:
    """Knowledge of the servos in the simulation that is judged; (n,) each, or None."""

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
    inertia = np.array([float(m.inertia.mean()) for m in motions])
    softest = UNKNOWN_STIFFNESS * float(_gravity(motions).max())
    unknown = np.maximum(softest, UNKNOWN_BANDWIDTH**2 * inertia)
    out[:, INDEX["stiffness"]] = unknown if servo.stiffness is None else servo.stiffness
    if servo.damping is not None:
        out[:, INDEX["damping"]] = servo.damping
    elif servo.stiffness is not None:
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


def unknown_damping(servo: Servo) -> bool:
    """Return whether the servos' damping is fitted and not judged."""
    return servo.damping is None and servo.parameters is None and not servo.perfect


def without_scale(servo: Servo, scaled: bool) -> bool:
    """Return whether only the motion of other joints sets the scale of a joint's torques.

    Its own inertia does not: the rotor's is unknown.
    """
    return servo.perfect and not servo.same and not scaled


def always_fitted(
    servo: Servo, motion: JointMotion, links: Array, nominal: Array, scaled: bool
) -> dict[str, float]:
    """Return parameters that are fitted and no cause, with the usual size of their change [SI].

    These are small errors of stamps, links (2,) as of `links_off`, bristles and stated gains,
    unknown damping, and the stiffness and rotor of a servo `without_scale`. ``nominal`` are the
    joint's (P,) parameters; ``scaled`` says whether gravity scales the servo's torque.
    """
    stiffness = float(nominal[INDEX["stiffness"]])
    out = {"delay": STAMPS, "armature": LINK_INERTIAS * float(motion.inertia.mean())}
    out["bristle"] = BRISTLES
    if without_scale(servo, scaled):
        out["armature"] = servo_cause("armature").servo.sizes["armature"] * stiffness
        out["stiffness"] = UNKNOWN_OFF
    if scaled and not servo.perfect:
        out |= zip(("compensation", "offset"), links.tolist(), strict=True)
        out["stiffness"] = SERVO_OFF
    if unknown_damping(servo):
        out["damping"] = servo_cause("damping").servo.sizes["damping"] * stiffness
    elif (damping := float(nominal[INDEX["damping"]])) > 0 and not servo.perfect:
        out["damping"] = SERVO_OFF * damping
    return out


def possible_causes(
    servo: Servo, motion: JointMotion, resolution: float, scaled: bool
) -> dict[str, InServo]:
    """Return the causes that a motion could show.

    ``resolution`` is the step of the angle [rad]; ``scaled`` says whether gravity scales the
    servo's torque.
    """
    least = MOVES * resolution
    if np.ptp(motion.command) < least or np.ptp(motion.q) < least:
        return {}
    return {
        name: part
        for name, part in causes_of_joints().items()
        if (scaled or not part.of_gravity)
        and not (servo.perfect and part.of_known_servo)
        and not ("damping" in part.sizes and unknown_damping(servo))
        and not ("armature" in part.sizes and without_scale(servo, scaled))
    }


def heavy(motions: Sequence[JointMotion]) -> Bools:
    """Return (n,) whether gravity acts on each joint."""
    gravity = _gravity(motions)
    return np.asarray(gravity > LEAST_GRAVITY * gravity.max())


def _gravity(motions: Sequence[JointMotion]) -> Array:
    """Return (n,) the largest gravity torque of each joint [N·m]."""
    return np.array([np.abs(m.gravity).max() for m in motions])


def scaled(servo: Servo, motions: Sequence[JointMotion], resolution: Array) -> Bools:
    """Return (n,) whether gravity scales each servo's torque; ``resolution`` as of `resolution_of`.

    An unknown servo must sag by more than the angle's step; one of known stiffness shows gravity by
    a sag that is missing, too.
    """

    def sags(motion: JointMotion, step: float) -> bool:
        return bool(sag_of(motion) * rms(motion.gravity) > GRAVITY_SEEN * step)

    known = not servo.perfect
    each = zip(heavy(motions), motions, resolution, strict=True)
    return np.array([bool(h) and (known or sags(m, step)) for h, m, step in each])


def sag_of(motion: JointMotion) -> float:
    """Return by how much a joint sags per torque of gravity [rad/(N·m)]; below 0 if it rises.

    Lag and dry friction stretch a servo too, and short motions correlate them with gravity.
    """
    columns = np.stack([motion.gravity, *motion.smooth_speed()], axis=1)
    return float(np.linalg.lstsq(columns, motion.command - motion.q, rcond=None)[0][0])


def unmodelled(motion: JointMotion, counts: Bools) -> float:
    """Return the error of a joint's angle that no model explains [rad]: `LEFT` of its distance from
    the command over rows (T,) that count, less what gravity explains.
    """
    stretched = motion.command - motion.q
    weight = np.stack([motion.gravity, motion.slope], axis=1)
    stretched = stretched - weight @ np.linalg.lstsq(weight, stretched, rcond=None)[0]
    return LEFT * float(np.sqrt(np.mean(stretched[counts] ** 2)))


def passed_speed(motion: JointMotion) -> float:
    """Return the least speed limit that the motion allows [rad/s].

    Over some time a joint goes no further than its reference, but for how far it stood behind at
    first and is ahead at last; the reference is no further from it than its command.
    """
    fastest = 0.0
    for seconds in (0.25, 0.5, 1.0):
        k = motion.rows_in(seconds)
        for a, b in pairwise(motion.bounds):
            went = motion.q[a + k : b] - motion.q[a : b - k]
            if len(went) < PASSED:
                continue
            ahead = (motion.command - motion.q)[a:b]
            before, after = np.sign(went) * ahead[:-k], -np.sign(went) * ahead[k:]
            alone = np.abs(went) - np.maximum(before, 0.0) - np.maximum(after, 0.0)
            fastest = max(fastest, float(np.sort(alone)[-PASSED:].mean()) / seconds)
    return fastest


def links_off(arm: Arm, motions: Sequence[JointMotion]) -> Array:
    """Return (n, 2) usual error of each joint's gravity because links are off.

    Of its size, over it [-], and as an angle [rad].
    """
    model = arm.model()
    moment = np.zeros(arm.n)
    for j in range(arm.n):
        beyond, body = [], model.jnt_bodyid[j]
        for k in range(body, model.nbody):
            at = k
            while at > body:
                at = model.body_parentid[at]
            beyond.append(model.body_mass[k] * (at == body))
        moment[j] = LINK_CENTRES * np.linalg.norm(model.opt.gravity) * np.linalg.norm(beyond)
    amplitude = np.array([np.sqrt(np.mean(m.gravity**2 + m.slope**2)) for m in motions])
    angle = moment / np.maximum(amplitude, 1e-9)
    return np.stack([np.hypot(LINK_MASSES, angle), angle], axis=1)


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


def swing_at_rest(motion: JointMotion, angle: Array) -> float:
    """Return the root mean square swing of an angle (T,) while the command rests [rad]."""
    starts = np.concatenate([[True], np.diff(motion.command) != 0.0])
    starts[motion.bounds[:-1]] = True
    rest = np.cumsum(starts) - 1
    settled = motion.t - motion.t[starts][rest] > SETTLED
    counts = np.bincount(rest[settled])
    if not len(counts):
        return 0.0
    mean = np.bincount(rest[settled], angle[settled]) / np.maximum(counts, 1)
    return float(np.std((angle - mean[np.minimum(rest, len(mean) - 1)])[settled]))


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


def notes_of(arm: Arm, logs: Sequence[ServoLog]) -> list[str]:
    """Return notes on the model's limits and springs, and on commands that come late."""
    q = np.concatenate([log.q for log in logs])
    out = ["springs of the robot's file are left out"] if arm.stated.stiffness.any() else []
    turns = arm.limits.assumed("position")
    for j, (low, high) in enumerate(arm.limits.position):
        least, most = float(q[:, j].min()), float(q[:, j].max())
        if not turns[j] and (least < low or most > high):
            out.append(
                f"joint {j + 1} was logged from {least:.4g} to {most:.4g} rad, its model ends at "
                f"{low:.4g} and {high:.4g}: the limits were widened, check its zero"
            )
    for log in logs:
        left = np.zeros((len(AHEAD), log.n))
        for s in log.segments:
            for j in range(log.n):
                t, command, q = log.t[s], log.q_cmd[s, j], log.q[s, j]
                left[:, j] += [np.sum(np.square(np.interp(t + x, t, command) - q)) for x in AHEAD]
        late = AHEAD[np.argmin(left, axis=0)]
        early = 1e3 * late[(late > EARLY) & (left.min(axis=0) < EARLY_LEAVES * left[0])]
        if len(early):
            out.append(
                f"{Path(log.source).name}: the command comes {early.min():.0f} to "
                f"{early.max():.0f} ms after the motion of {len(early)} joints: check the stamps"
            )
    return out
