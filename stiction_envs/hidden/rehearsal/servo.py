"""Servo logs in which causes are hidden: the arm simulated anew along their commands.

    subject = subject_of(own)                    # of the diagnosis of the user's own logs
    subject.run(job, sizes, seed, 1)             # with a cause in it: what is named?

Stock MuJoCo simulates the arm under its servos, given the commands of the log. Angles get what the
log's own diagnosis leaves, with random phases (`replay.surrogate`), and are rounded to its
encoder's steps; times are those of the log, and where its angles are younger than their stamps (a
negative delay), they are here. Servos of unknown stiffness and damping have what the diagnosis
found, and are then named rightly.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.servo.causes import ServoLag, servo_cause
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.questions import (
    Servo,
    heavy,
    nominal_parameters,
    possible_causes,
    resolution_of,
    sags,
    unknown_damping,
)
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis, diagnose_servo
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.servo_payload import gravity_of_tip
from stiction_envs.hidden.rehearsal.jobs import (
    LARGE_NOISE,
    LARGE_SHARE,
    NO_JOB,
    NOTHING,
    CauseJob,
    RehearsalRun,
)
from stiction_envs.hidden.rehearsal.replay import LEAST_FRICTION, surrogate
from stiction_envs.hidden.servo_effects import EFFECTS, ServoEffect, ServoJoint
from stiction_envs.hidden.servo_simulation import simulate
from stiction_envs.hidden.torque_effects import COM
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

USUAL_PERCENT, REACHED_PERCENT = 70.0, 99.5
"""Percentiles of a joint's angle where it mostly is, and of what it reaches [%]; assumed."""
TRIED, SMALLEST = 40, 1e-4
"""Number of sizes whose effect is simulated to find three, and the least over the largest [-];
assumed: they are 26 % apart, and interpolated."""
NO_CHANGE = 1e-3  # change of the angle over the noise that is none [-]; assumed
SPARSE = 10  # rows of which one shows a body's gravity [-]; assumed


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenServos:
    """Servo logs, the arm behind them, and their noise."""

    arm: Arm
    """As its user models it."""
    logs: tuple[ServoLog, ...]
    servo: Servo
    """Known stiffness and damping of the servos."""
    motions: list[JointMotion]
    base: Array
    """(n, P) parameters with nothing hidden."""
    right: frozenset[tuple[str, int]]
    """Causes and joints (from 1) that are named rightly with nothing hidden."""
    joints: tuple[ServoJoint, ...]
    left: tuple[Array, ...]
    """Per log, (T, n) what its own diagnosis leaves of the angles [rad]."""
    noise: Array
    """(n,) root mean square of it, at least the noise floor [rad]."""
    resolution: Array
    """(n,) step of the angles [rad]."""

    def jobs_of(self, names: Collection[str]) -> list[CauseJob]:
        """Return the jobs of causes, in the order of their table."""
        jobs = [NO_JOB]
        for effect in (EFFECTS[x] for x in EFFECTS if x in names):
            why_not = {j: self._why_not(effect.name, j) for j in range(len(self.base))}
            left = tuple(j for j, why in why_not.items() if not why)
            if left:
                jobs.append(CauseJob(what=effect, joints=left))
            if not (effect.arm_wide and left):
                unseen = [
                    CauseJob(what=effect, joints=(j,), why_not=x) for j, x in why_not.items() if x
                ]
                jobs += unseen[:1] if effect.arm_wide else unseen
        return jobs

    def _why_not(self, name: str, j: int) -> str:
        """Return why a cause cannot show on a joint (from 0), or nothing."""
        motion = self.motions[j]
        step = float(self.resolution[j])
        known = None if self.servo.perfect else float(self.base[j, INDEX["stiffness"]])
        scaled = heavy(self.motions)[j] and sags(motion, step, known)
        if self.servo.perfect and name in ("servo_stiffness", "damping"):
            return "nobody said what it should be, so it is named as it is"
        if self.servo.perfect and name in (
            *("encoder_offset", "gravity_compensation_missing", "payload"),
        ):
            return "nobody said how stiff the servos are, and softer ones sag alike"
        if name == "damping" and unknown_damping(self.servo):
            return "nobody said what it should be, so it is fitted and not judged"
        possible = possible_causes(self.servo, motion, step, scaled)
        if not possible:
            return f"joint {j + 1} hardly moves"
        if name in (*possible, "payload", "external_contact"):
            return ""
        return f"gravity does not sag joint {j + 1} enough to scale its torques"

    def sizes(self, job: CauseJob) -> tuple[Array, Array, Array]:
        whole = np.array([float(m.q.std()) for m in self.motions])
        targets = self.noise, np.maximum(LARGE_NOISE * self.noise, LARGE_SHARE * whole)
        if job.what.arm_wide:
            small, large = (self._mass(target) for target in targets)
        else:
            small, large = np.zeros((2, len(self.base)))
            for j in job.joints:
                of_joint = [float(target[j]) for target in targets]
                small[j], large[j] = self._size(EFFECTS[job.cause], j, of_joint)
        return small, np.sqrt(small * large), large

    def _size(self, effect: ServoEffect, j: int, targets: Sequence[float]) -> list[float]:
        """Return the sizes that change a joint's angle by root mean squares [rad]; 0 if none."""
        motion, joint = self.motions[j], self.joints[j]
        tried = effect.largest * np.geomspace(SMALLEST, 1.0, TRIED)
        without = effect.before(joint).parameters
        sets = np.stack([without, *(effect.changed(joint, float(x)) for x in tried)])
        plain, *angles = motion.simulate(sets)
        if effect is EFFECTS["external_contact"]:
            angles = [_behind_wall(plain, effect.shown(joint, float(x))) for x in tried]
        change = np.nan_to_num([float(np.sqrt(np.mean((a - plain) ** 2))) for a in angles])
        grows = np.maximum.accumulate(change)
        if grows[-1] < NO_CHANGE * self.noise[j]:
            return [0.0 for _ in targets]
        grows = np.maximum(grows, 1e-15) * (1.0 + 1e-12 * np.arange(TRIED))  # strictly rising
        at = np.interp(np.log(targets), np.log(grows), np.log(tried))
        return [float(x) for x in np.exp(at)]

    def _mass(self, target: Array) -> Array:
        """Return (n,) masses at the flange [kg] by which one joint sags by its target [rad]."""
        q = np.stack([m.q for m in self.motions], axis=1)[::SPARSE]
        torque = gravity_of_tip(self.arm, q) @ np.concatenate([[1.0], COM])
        sag = np.sqrt(np.mean(torque**2, axis=0)) / self.base[:, INDEX["stiffness"]]
        mass = float(np.min(target / np.maximum(sag, 1e-12)))
        return np.full(len(target), min(mass, EFFECTS["payload"].largest))

    def run(self, job: CauseJob, size: Array, seed: int, number: int) -> RehearsalRun:
        rng = np.random.default_rng([seed, zlib.crc32(job.key.encode()), number])
        parameters, sizes, mass = self.base.copy(), {}, 0.0
        wall = np.zeros(len(parameters))
        if job.what.arm_wide:
            mass = float(size[0])
            sizes = {"0": mass}
        elif job.cause != NOTHING:
            effect = EFFECTS[job.cause]
            for j in (j for j in job.joints if size[j] > 0):
                parameters[j] = effect.changed(self.joints[j], float(size[j]))
                sizes[str(j + 1)] = effect.shown(self.joints[j], float(size[j]))
                if job.cause == "external_contact":
                    wall[j] = sizes[str(j + 1)]
        logs = self._logs(parameters, mass, wall, rng)
        said = diagnose_servo(logs, self.arm, self.servo, threads=1)
        named = []
        for c in said.causes:
            joints = [j for j in c.joints if c.name == job.cause or (c.name, j) not in self.right]
            always = servo_cause(c.name).servo.alike
            if joints:
                named.append([c.name, joints, [x for x in c.confused_with if x not in always]])
        return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}

    def _logs(
        self, parameters: Array, mass: float, wall: Array, rng: np.random.Generator
    ) -> list[ServoLog]:
        """Return the logs with noise of an arm that carries a mass [kg].

        Angles above a wall (n,) [rad] stop at the wall.
        """
        out, payload = [], (mass, *COM) if mass else None
        for log, left in zip(self.logs, self.left, strict=True):
            seen = log.q.copy()
            for s in log.segments:
                if s.stop - s.start > 1:
                    motion = log.t[s], log.q_cmd[s], log.q[s.start]
                    seen[s] = simulate(self.arm, parameters, *motion, payload)
            seen = _behind_wall(seen, wall)
            for s in log.segments:
                seen[s] += surrogate(left[s], rng)
            seen = np.round(seen / self.resolution) * self.resolution
            out.append(replace(log, q=seen, dq=None, tau=None, current=None))
        return out


def _behind_wall(angle: Array, depth: Array | float) -> Array:
    """Return angles (T, …) that stop so far below the top of their motion [rad]."""
    return np.minimum(angle, angle.max(axis=0) - depth)


def subject_of(own: ServoDiagnosis, arm: Arm) -> HiddenServos:
    """Return the logs of a diagnosis of the rigid ``arm``, to hide causes in them."""
    motions = joint_motions(arm, own.logs)
    base = _base(own, motions)
    left = []
    for log, angle, touched in zip(own.logs, own.angles, own.touched, strict=True):
        error = np.nan_to_num(log.q - angle)
        error[touched] = 0.0
        left.append(error)
    noise = np.sqrt(np.mean(np.concatenate(left) ** 2, axis=0))
    noise = np.maximum(noise, own.noise)
    return HiddenServos(
        arm=arm,
        logs=own.logs,
        servo=own.servo,
        motions=motions,
        base=base,
        right=frozenset(_right(own, base)),
        joints=tuple(
            _joint(m, p, found, float(x))
            for m, p, found, x in zip(motions, base, own.parameters, noise, strict=True)
        ),
        left=tuple(left),
        noise=noise,
        resolution=np.array([resolution_of(m.q) for m in motions]),
    )


def _base(own: ServoDiagnosis, motions: Sequence[JointMotion]) -> Array:
    """Return (n, P) parameters of the arm as it is judged; what is unknown is as it was found."""
    out = nominal_parameters(own.servo, motions)
    found = {name: own.parameters[:, k] for name, k in INDEX.items()}
    early = found["delay"] < 0.0
    out[early, INDEX["delay"]] = np.minimum(out[:, INDEX["delay"]], found["delay"])[early]
    if own.servo.perfect:
        out[:, INDEX["stiffness"]] = found["stiffness"]
        late = found["damping"] + found["stiffness"] * np.maximum(found["delay"], 0.0)
        out[:, INDEX["damping"]] = late
    elif own.servo.damping is None and own.servo.parameters is None:
        out[:, INDEX["damping"]] = found["damping"]
    return out


def _right(own: ServoDiagnosis, base: Array) -> set[tuple[str, int]]:
    """Return the causes and joints (from 1) of an arm in which nothing is hidden."""
    joints = range(1, len(base) + 1)
    names = ("servo_stiffness", "damping", ServoLag.name) if own.servo.perfect else ()
    late = {j for j in joints if base[j - 1, INDEX["delay"]] < 0.0}
    return {(x, j) for x in names for j in joints} | {
        (x, j) for x in ("delay", ServoLag.name) for j in late
    }


def _joint(motion: JointMotion, base: Array, found: Array, noise: float) -> ServoJoint:
    """Return a joint before something is hidden in it; base and found are (P,) parameters."""
    stiffness = float(base[INDEX["stiffness"]])
    angle = motion.simulate(base[None])[0]
    reached = float(np.nanpercentile(np.abs(motion.command - angle), REACHED_PERCENT))
    speed = np.abs(np.diff(angle) / np.diff(motion.t))
    friction = float(max(found[INDEX["stiction"]], base[INDEX["stiction"]]))
    return ServoJoint(
        parameters=base,
        friction=friction if friction > 0.0 else LEAST_FRICTION * noise * stiffness,
        gravity=float(np.abs(motion.gravity).max()),
        torque=stiffness * reached,
        speed=float(np.nanpercentile(speed, REACHED_PERCENT)),
        inertia=float(motion.inertia.mean()),
        above=float(motion.q.max() - np.percentile(motion.q, USUAL_PERCENT)),
    )
