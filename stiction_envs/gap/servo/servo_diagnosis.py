"""From servo logs to named causes: each joint by itself, then the whole arm as it is reported."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.gap.judge.judgement import Judgement, ModelCheck
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.model_file import changed_arm
from stiction_envs.gap.servo import motion, questions, whole_arm
from stiction_envs.gap.servo.findings import (
    carried,
    contact,
    joint_causes,
    refit,
    reported_columns,
    verdict_of,
)
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.joint_search import (
    PERFECT,
    JointFindings,
    JointProblem,
    Question,
    judge,
)
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.servo_payload import Tip, proposed
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

Progress = Callable[[str, float], None]
"""Called with a stage and its part done."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoDiagnosis(Judgement):
    """Findings of servo logs about a simulation."""

    servo: Servo
    """Knowledge of the servos before the diagnosis."""
    payload: Tip | None
    """A body at the flange that was found."""
    nominal_rms: Array
    """(n,) error of the nominal simulation [rad]."""
    extended_rms: Array
    """(n,) held-out error of the whole arm with the causes [rad]."""
    noise: Array
    """(n,) noise floor of the angle [rad]."""
    parameters: Array
    """(n, P) of the extended model."""
    load: Array
    """(n,) usual size of gravity [N·m]."""
    logs: tuple[ServoLog, ...]
    nominal_angles: tuple[Array, ...]
    """Per log, (T, n) [rad]."""
    angles: tuple[Array, ...]
    """Per log, (T, n) held-out angles of the extended model [rad]."""
    touched: tuple[Bools, ...]
    """Per log, (T,) rows that were left out: the arm touches something."""
    notes: tuple[str, ...]
    check: ModelCheck | None = None

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean of extended over nominal error) [%], over joints that are off by more than
        noise."""
        off = self.nominal_rms > self.noise
        if not self.causes or not off.any():
            return 0.0
        share = self.extended_rms[off] / self.nominal_rms[off]
        return float(100.0 * (1.0 - share.mean()))

    def to_json(self) -> dict[str, object]:
        """Return ``diagnosis.json``."""
        out: dict[str, object] = {
            "robot": self.robot,
            "drive": "position",
            "verdict": self.verdict,
            "nominal": {"rms_rad": self.nominal_rms.tolist(), "held_out": True},
            "extended": {"rms_rad": self.extended_rms.tolist(), "held_out": True},
            "noise_floor_rad": self.noise.tolist(),
            "gain_percent": self.gain_percent,
            **self.judged_json(),
            "servo": {key: x.tolist() for key, x in reported_columns(self.parameters).items()},
            "notes": list(self.notes),
        }
        if self.check is not None:
            out["check"] = self.check.to_json()
        return out


class _Joints:
    """The joints of one arm along its logs, what is asked about each, and what was found."""

    def __init__(
        self,
        logs: Sequence[ServoLog],
        arm: Arm,
        servo: Servo,
        workers: ThreadPoolExecutor,
        say: Progress,
        motions: list[JointMotion] | None = None,
    ) -> None:
        self.logs, self.arm, self.servo = logs, arm, servo
        self.workers, self.say = workers, say
        self.motions = motion.joint_motions(arm, logs) if motions is None else motions
        self.n = arm.n
        self.resolution = np.array([questions.resolution_of(m.q) for m in self.motions])
        rest = [questions.rest_noise(m) for m in self.motions]
        self.noise = np.maximum(self.resolution / np.sqrt(12.0), rest)
        self.load = np.array([float(np.abs(m.gravity).mean()) for m in self.motions])
        self.nominal = questions.nominal_parameters(servo, self.motions)
        self.heavy = questions.heavy(self.motions)
        self.scaled = questions.scaled(servo, self.motions, self.resolution)
        if servo.same and not self.scaled.any():
            self.servo = replace(servo, same=False)
        for j in np.flatnonzero(self.scaled) if servo.perfect else []:
            self.nominal[j, INDEX["stiffness"]] = 1.0 / questions.sag_of(self.motions[j])
        self.links = questions.links_off(arm, self.motions)
        # rows on which each joint's causes are chosen
        each = zip(self.motions, self.resolution, strict=True)
        heads = [m.heads(questions.shown(m, r)) for m, r in each]
        self.chosen, self.shown = [m for m, _ in heads], [some for _, some in heads]
        self.notes = questions.notes_of(arm, logs)
        self.lasts: dict[int, float] = {}
        self.free = np.ones(len(self.motions[0].t), dtype=bool)
        """(T,) rows without contact."""
        self.found: dict[int, JointFindings] = {}

    def again(
        self, *, arm: Arm | None = None, motions: list[JointMotion] | None = None
    ) -> "_Joints":
        """Return joints and causes of another arm or other motions; errors last as long as here."""
        other = _Joints(self.logs, arm or self.arm, self.servo, self.workers, self.say, motions)
        other.lasts = {j: r.noise.last for j, r in self.found.items()}
        other.free = self.free
        other.choose()
        return other

    @property
    def score(self) -> float:
        """Log evidence and log prior odds of all joints, less what every name must bring."""
        return sum(joint.score - NAMED * len(joint.causes) for joint in self.found.values())

    def with_cause(self, cause: str) -> list[int]:
        """Return the joints (from 0) on which a cause was found."""
        return [j for j, joint in self.found.items() if cause in joint.causes]

    def question(self, j: int, counts: Bools) -> Question:
        """Return the question about a joint; ``counts`` are rows of those shown."""
        scaled, nominal = self.scaled[j], self.nominal[j].copy()
        perfect = self.servo.perfect and scaled
        nominal[INDEX["stiffness"]] *= PERFECT if perfect else 1.0
        m = self.chosen[j]
        if self.servo.perfect and not scaled and self.heavy[j]:
            nominal[INDEX["compensation"]] = 1.0  # gravity that does not sag a joint is compensated
        causes = [
            questions.possible_causes(self.servo, *x)
            for x in zip(self.chosen, self.resolution, self.scaled, strict=True)
        ]
        return Question(
            motion=m,
            nominal=nominal,
            always=questions.always_fitted(self.servo, m, self.links[j], nominal, scaled),
            candidates=causes[j],
            hypotheses=max(1, sum(len(x) for x in causes)),
            counts=counts,
            floor=float(np.hypot(self.noise[j], questions.unmodelled(m, counts))),
            last=self.lasts.get(j),
            perfect=perfect,
            without_scale=questions.without_scale(self.servo, scaled),
        )

    def contacts(self) -> dict[int, Bools]:
        """Return by joint the (T,) rows in which it seems to touch something."""

        def error_of(j: int) -> Array:
            counts = ~motion.suspected(self.motions[j])[self.shown[j]]
            rough, _ = JointProblem(self.question(j, counts)).rough()
            return self.motions[j].q - self.motions[j].simulate(rough.parameters[None])[0]

        out = {}
        for j, error in enumerate(self.workers.map(error_of, range(self.n))):
            touches = motion.in_contact(self.motions[j], error, float(self.resolution[j]))
            if touches.any():
                out[j] = touches
        many = bool(out) and np.any([*out.values()], axis=0).mean() > motion.MOST_IN_CONTACT
        return {} if many else out

    def pushed(self, contacts: dict[int, Bools]) -> dict[int, Bools]:
        """Return the contacts in which the motor pushes; of others the notes say that it rests."""
        none = [np.full_like(x.q, np.nan) for x in self.logs]
        each = [y if x.current is None else x.current for x, y in zip(self.logs, none, strict=True)]
        currents, out = whole_arm.rows(self.logs, each), {}
        for j, touches in contacts.items():
            out[j] = motion.pushing(currents[:, j], touches)
            for begin, end in motion.stretches(self.motions[j].t, touches & ~out[j]):
                self.notes.append(
                    f"joint {j + 1} stands far from its command from {begin:.4g} to {end:.4g} s "
                    "while its motor draws no more current than elsewhere: its servo rests; left "
                    "out"
                )
        return {j: touches for j, touches in out.items() if touches.any()}

    def choose(self) -> None:
        """Find the causes of each joint."""

        def one(j: int) -> JointFindings:
            found = judge(self.question(j, self.free[self.shown[j]]))
            self.say("choosing causes", (len(self.found) + 1) / self.n)
            return found

        heavy = [j for j in range(self.n) if self.scaled[j] or not self.servo.perfect]
        light = [j for j in range(self.n) if j not in heavy]
        self.found |= dict(zip(heavy, self.workers.map(one, heavy), strict=True))
        if light:
            self._set_stiffness(light, [self.found[j].fit["stiffness"] for j in heavy])
            self.found |= dict(zip(light, self.workers.map(one, light), strict=True))
        if loose := [j for j in light if not self.scaled[j]]:
            shown = "servos" if self.servo.same else "motion"
            values = [f"{self.found[j].predicting['stiffness']:.3g}" for j in loose]
            self.notes.append(
                f"joints {', '.join(str(j + 1) for j in loose)}: gravity sets no scale of "
                f"their torques; by the {shown} of the other joints, the servo stiffness is about "
                f"{' '.join(values)} N·m/rad; inertia, friction, damping and limits scale with it"
            )

    def _set_stiffness(self, light: Sequence[int], stiffnesses: Sequence[float]) -> None:
        """Give joints that do not clearly sag the stiffness of the others: all are the same."""
        for j in light if self.servo.same else []:
            m, stiffness = self.motions[j], float(np.median(stiffnesses))
            self.nominal[j, INDEX["stiffness"]] = stiffness
            # with the others' stiffness it may sag enough after all
            seen = np.abs(m.gravity).max() > questions.GRAVITY_SEEN * self.resolution[j] * stiffness
            self.scaled[j] = bool(seen and self.heavy[j])

    def helped(self, nominal: Array, extended: Array) -> list[int]:
        """Return the joints whose causes may be named: none, where the model is worse in all.

        A model that is worse than the simulation on held-out time explains nothing. Errors are
        (n,), nominal and held-out [rad].
        """
        if not any(joint.causes for joint in self.found.values()):
            return list(self.found)
        moving = np.array([np.ptp(m.q) for m in self.motions]) >= questions.MOVES * self.resolution
        worse = moving & (extended > whole_arm.WORSE * nominal)
        share = extended[moving] / np.maximum(nominal[moving], 1e-12)
        if not moving.any() or share.mean() >= 1.0:
            self.notes.append(
                "the model that fits best is no better than the simulation on held-out time: "
                "nothing is named"
            )
            return []
        for j in np.flatnonzero(worse):
            self.notes.append(
                f"joint {j + 1}: on held-out time the model is worse than the simulation "
                f"({1e3 * extended[j]:.3g} against {1e3 * nominal[j]:.3g} mrad): nothing is named"
            )
        return np.flatnonzero(moving & ~worse).tolist()

    def unstable(self, nominal: Array) -> list[int]:
        """Return the joints that swing around a command that rests as no model does, and say so.

        ``nominal`` (n,) are the errors of the nominal simulation [rad].
        """
        out = []
        for j, found in self.found.items():
            m = self.chosen[j]
            swing, left = (questions.swing_at_rest(m, x) for x in (m.q, found.fit.error))
            least = max(questions.SWINGS * nominal[j], questions.MOVES * self.resolution[j])
            if swing > least and left > questions.SWINGS * swing:
                out.append(j)
                self.notes.append(
                    f"joint {j + 1} swings by {np.sqrt(2.0) * swing:.2g} rad around commands that "
                    "rest: its control loop is unstable or hardly damped (gain, delay, torque "
                    "limit), which is no friction: nothing is named"
                )
        return out

    def lost(self, other: "_Joints") -> Array:
        """Return (n,) error [rad] that a payload takes off; ``other`` are joints that carry it."""
        out = np.empty(self.n)
        for j, m in enumerate(self.chosen):
            fit, counts = other.found[j].fit, self.free[self.shown[j]]
            angle = m.simulate(fit.parameters[None])[0]
            without, with_it = (np.mean(x[counts] ** 2) for x in (m.q - angle, fit.error))
            out[j] = np.sqrt(without) - np.sqrt(with_it)
        return out


def _with_tip(joints: _Joints) -> tuple[_Joints, Tip | None, float]:
    """Return the joints of the arm with a body at its flange, where that explains more.

    The body follows, and the nats against the arm without it.
    """
    if joints.servo.perfect:  # its stiffness would take up any body
        return joints, None, 0.0
    shifted = joints.with_cause("encoder_offset")
    tip = proposed(joints.arm, joints.motions, joints.nominal, joints.free, shifted=shifted)
    if tip is None or tip.nats < NAMED:
        return joints, None, 0.0
    loaded = joints.again(arm=changed_arm(joints.arm, [tip.part(1)]))
    nats = min(loaded.score - joints.score - tip.cost, tip.nats)
    return (loaded, tip, nats) if nats > NAMED else (joints, None, 0.0)


def _with_zero(joints: _Joints) -> _Joints:
    """Return the joints where the others know of one joint whose zero is off.

    It changes the gravity of its neighbours, which would otherwise need offsets of their own.
    """
    best = joints
    for j in joints.with_cause("encoder_offset"):
        zeros = np.zeros(joints.n)
        zeros[j] = joints.found[j].fit["offset"]
        motions = motion.joint_motions(joints.arm, joints.logs, zeros)
        motions[j] = joints.motions[j]  # its own fit has the offset as a parameter
        known = joints.again(motions=motions)
        if known.score > best.score:
            best = known
    return best


def diagnose_servo(
    logs: Sequence[ServoLog],
    arm: Arm,
    servo: Servo,
    *,
    check: Sequence[ServoLog] = (),
    threads: int = 0,
    progress: Progress | None = None,
) -> ServoDiagnosis:
    """Name what a simulated position servo gets wrong about servo logs.

    The nominal simulation has servos of the given stiffness and damping (critical, where it is not
    given) and no friction; without a stiffness its servos are perfect: q = q_cmd.

    Args:
        logs: of one robot.
        arm: the rigid arm.
        servo: what is known of its servos.
        check: logs that take no part and test the model.
        threads: threads, 0 for all processors.
        progress: called with a stage and its part done.
    """
    say = progress or (lambda *_: None)
    say("inverse dynamics", 0.0)
    with ThreadPoolExecutor(max_workers=threads or None) as workers:
        before = _Joints(logs, arm, servo, workers, say)
        say("columns of all causes", 0.0)
        contacts = before.contacts()
        free = before.free = ~np.any([~before.free, *contacts.values()], axis=0)
        before.choose()
        plain = whole_arm.nominal_angles(arm, logs, servo, before.nominal, before.load)
        joints, tip, nats = _with_tip(before)
        joints = _with_zero(joints)
        say("refitting", 0.0)
        first, second = whole_arm.folds(joints.motions[0])
        found = [joints.found[j] for j in range(joints.n)]
        fits = [
            workers.map(partial(refit, counts=counts), joints.motions, found)
            for counts in (free, free & first, free & second)
        ]
        final, *parts = (np.stack(list(x)) for x in fits)
        say("forward validation", 0.0)
        jobs = [
            workers.submit(whole_arm.simulate_arm, joints.arm, logs, p, joints.load, threads=1)
            for p in parts
        ]
        halves = [whole_arm.rows(logs, job.result()) for job in jobs]
        held = np.where(first[:, None], halves[1], halves[0])
    nominal_rms, extended_rms = (whole_arm.errors_of(logs, x, free) for x in (plain, held))
    unstable = joints.unstable(nominal_rms)
    helped = [j for j in joints.helped(nominal_rms, extended_rms) if j not in unstable]
    causes = joint_causes({j: joints.found[j] for j in helped}, nominal_rms)
    if pushed := joints.pushed(contacts):
        causes.append(contact(pushed, joints.motions[0].t))
    tip = tip if helped else None
    if tip is not None:
        causes.append(carried(tip, before.lost(joints), nominal_rms, nats))
    causes.sort(key=lambda c: -c.gain_percent)
    checked = None
    if check:
        say("check", 0.0)
        checked = whole_arm.check_model(
            check,
            whole_arm.nominal_angles(arm, check, servo, before.nominal, before.load),
            whole_arm.rows(check, whole_arm.simulate_arm(joints.arm, check, final, joints.load)),
            extended_rms,
        )
    return ServoDiagnosis(
        robot=arm.name,
        servo=servo,
        payload=tip,
        verdict=verdict_of(causes, nominal_rms, extended_rms, joints.noise),
        causes=tuple(causes),
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        noise=joints.noise,
        parameters=final,
        load=joints.load,
        logs=tuple(logs),
        nominal_angles=tuple(whole_arm.per_log(logs, plain, np.nan)),
        angles=tuple(whole_arm.per_log(logs, held, np.nan)),
        touched=tuple(whole_arm.per_log(logs, ~free, False)),
        notes=tuple(joints.notes),
        check=checked,
    )
