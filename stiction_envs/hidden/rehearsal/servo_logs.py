"""Servo logs in which causes are hidden: the arm simulated anew along their commands.

Stock MuJoCo simulates the arm under its servos, given the commands of the log. Angles get what the
log's own diagnosis leaves (`surrogate`), and are rounded to its encoder's steps; times are those of
the log, and where its angles are younger than their stamps (a negative delay), they are here.
Servos of unknown stiffness and damping have what the diagnosis found, and are then named rightly.
"""

from dataclasses import replace

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.servo.causes import ServoLag, servo_cause
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.questions import (
    nominal_parameters,
    possible_causes,
    resolution_of,
    scaled,
    unknown_damping,
)
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis, diagnose_servo
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.servo_payload import gravity_of_tip
from stiction_envs.hidden.rehearsal.jobs import (
    LEAST_FRICTION,
    NOTHING,
    CauseJob,
    Hideable,
    RehearsalRun,
    surrogate,
)
from stiction_envs.hidden.servo_effects import EFFECTS, ServoJoint
from stiction_envs.hidden.servo_simulation import simulate
from stiction_envs.hidden.torque_effects import COM
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

REACHED_PERCENT = 99.5  # percentile of what a joint reaches [%]; assumed
TRIED, SMALLEST = 40, 1e-4
"""Number of sizes whose effect is simulated to find one, and the least over the largest [-];
assumed: they are 26 % apart, and interpolated."""
NO_CHANGE = 1e-3  # change of the angle over the noise that is none [-]; assumed
SPARSE = 10  # rows of which one shows a body's gravity [-]; assumed
SAG_ALIKE = ("encoder_offset", "gravity_compensation_missing", "payload")
"""Causes that a softer servo looks like."""


class ServoLogs:
    """Servo logs in which causes can be hidden."""

    def __init__(self, own: ServoDiagnosis, arm: Arm) -> None:
        """Take motion and noise from the diagnosis of the logs, of the rigid ``arm``."""
        self.arm, self.own, self.servo = arm, own, own.servo
        self.motions = joint_motions(arm, own.logs)
        self.resolution = np.array([resolution_of(m.q) for m in self.motions])
        self.base, self.right = _base(own, self.motions)
        self.left: list[Array] = []
        for log, angle, touched in zip(own.logs, own.angles, own.touched, strict=True):
            error = np.nan_to_num(log.q - angle)
            error[touched] = 0.0
            self.left.append(error)
        noise = np.sqrt(np.mean(np.concatenate(self.left) ** 2, axis=0))
        self.noise = np.maximum(noise, own.noise)
        self.whole = np.array([float(m.q.std()) for m in self.motions])
        self.joints = [self._joint(j) for j in range(arm.n)]

    def _joint(self, j: int) -> ServoJoint:
        """Return a joint before something is hidden in it."""
        motion, base = self.motions[j], self.base[j]
        stiffness, stiction = float(base[INDEX["stiffness"]]), INDEX["stiction"]
        angle = motion.simulate(base[None])[0]
        reached = float(np.nanpercentile(np.abs(motion.command - angle), REACHED_PERCENT))
        speed = np.abs(np.diff(angle) / np.diff(motion.t))
        friction = float(max(self.own.parameters[j, stiction], base[stiction]))
        return ServoJoint(
            parameters=base,
            friction=friction or LEAST_FRICTION * float(self.noise[j]) * stiffness,
            gravity=float(np.abs(motion.gravity).max()),
            torque=stiffness * reached,
            speed=float(np.nanpercentile(speed, REACHED_PERCENT)),
            inertia=float(motion.inertia.mean()),
        )

    def why_not(self, what: Hideable, j: int) -> str:
        """Return why a cause cannot show on a joint (from 0), or nothing."""
        name, motion, step = what.name, self.motions[j], float(self.resolution[j])
        perfect = self.servo.perfect
        sagging = bool(scaled(self.servo, self.motions, self.resolution)[j])
        if perfect and name in ("servo_stiffness", "damping"):
            return "nobody said what it should be, so it is named as it is"
        if perfect and name in SAG_ALIKE:
            return "nobody said how stiff the servos are, and softer ones sag alike"
        if name == "damping" and unknown_damping(self.servo):
            return "nobody said what it should be, so it is fitted and not judged"
        possible = possible_causes(self.servo, motion, step, sagging)
        if not possible:
            return f"joint {j + 1} hardly moves"
        if name in (*possible, "payload"):
            return ""
        return f"gravity does not sag joint {j + 1} enough to scale its torques"

    def size(self, job: CauseJob, target: Array) -> Array:
        """Return sizes (n,) that change angles by root mean squares (n,) [rad]; 0 where none does.

        That of a payload lets one joint sag by its target.
        """
        effect, size = EFFECTS[job.what.name], np.zeros(self.arm.n)
        if effect.arm_wide:
            q = np.stack([m.q for m in self.motions], axis=1)[::SPARSE]
            torque = gravity_of_tip(self.arm, q) @ np.concatenate([[1.0], COM])
            sag = np.sqrt(np.mean(torque**2, axis=0)) / self.base[:, INDEX["stiffness"]]
            return size + min(float(np.min(target / np.maximum(sag, 1e-12))), effect.largest)
        tried = effect.largest * np.geomspace(SMALLEST, 1.0, TRIED)
        for j in job.joints:
            joint = self.joints[j]
            sets = [effect.before(joint).parameters]
            sets += [effect.changed(joint, float(x)) for x in tried]
            plain, *angles = self.motions[j].simulate(np.stack(sets))
            change = np.nan_to_num([float(np.sqrt(np.mean((a - plain) ** 2))) for a in angles])
            grows = np.maximum.accumulate(change)
            if grows[-1] >= NO_CHANGE * self.noise[j]:
                grows = np.maximum(grows, 1e-15) * (1.0 + 1e-12 * np.arange(TRIED))  # rising
                size[j] = np.exp(np.interp(np.log(target[j]), np.log(grows), np.log(tried)))
        return size

    def run(self, job: CauseJob, size: Array, rng: np.random.Generator) -> RehearsalRun:
        """Hide a cause of sizes (n,), diagnose the logs, and return what is named."""
        parameters, sizes, mass = self.base.copy(), {}, 0.0
        if job.what.arm_wide:
            mass = float(size[0])
            sizes = {"0": mass}
        elif job.what.name != NOTHING:
            effect = EFFECTS[job.what.name]
            for j in (j for j in job.joints if size[j] > 0):
                parameters[j] = effect.changed(self.joints[j], float(size[j]))
                sizes[str(j + 1)] = effect.shown(self.joints[j], float(size[j]))
        logs = self.logs(parameters, mass, rng)
        said = diagnose_servo(logs, self.arm, self.servo, threads=1)
        named = []
        for c in said.causes:
            own = c.name == job.what.name
            joints = [j for j in c.joints if own or (c.name, j) not in self.right]
            always = servo_cause(c.name).servo.alike
            if joints:
                named.append([c.name, joints, [x for x in c.confused_with if x not in always]])
        return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}

    def logs(self, parameters: Array, mass: float, rng: np.random.Generator) -> list[ServoLog]:
        """Return the logs with noise of an arm that carries a mass [kg]."""
        out, payload = [], (mass, *COM) if mass else None
        for log, left in zip(self.own.logs, self.left, strict=True):
            seen = log.q.copy()
            for s in log.segments:
                if s.stop - s.start > 1:
                    motion = log.t[s], log.q_cmd[s], log.q[s.start]
                    seen[s] = simulate(self.arm, parameters, *motion, payload)
                seen[s] += surrogate(left[s], rng)
            seen = np.round(seen / self.resolution) * self.resolution
            out.append(replace(log, q=seen, dq=None, tau=None, current=None))
        return out


def _base(own: ServoDiagnosis, motions: list[JointMotion]) -> tuple[Array, set[tuple[str, int]]]:
    """Return (n, P) parameters of the arm as it is judged; what is unknown is as it was found.

    Causes and joints (from 1) follow that are named rightly with nothing hidden.
    """
    out, names = nominal_parameters(own.servo, motions), tuple[str, ...]()
    found = {name: own.parameters[:, k] for name, k in INDEX.items()}
    early = found["delay"] < 0.0
    out[early, INDEX["delay"]] = np.minimum(out[:, INDEX["delay"]], found["delay"])[early]
    if own.servo.perfect:
        names = ("servo_stiffness", "damping", ServoLag.name)
        out[:, INDEX["stiffness"]] = found["stiffness"]
        late = found["damping"] + found["stiffness"] * np.maximum(found["delay"], 0.0)
        out[:, INDEX["damping"]] = late
    elif own.servo.damping is None and own.servo.parameters is None:
        out[:, INDEX["damping"]] = found["damping"]
    right = {(x, j) for x in names for j in range(1, len(out) + 1)}
    early_joints = np.flatnonzero(out[:, INDEX["delay"]] < 0.0) + 1
    return out, right | {(x, int(j)) for x in ("delay", ServoLag.name) for j in early_joints}
