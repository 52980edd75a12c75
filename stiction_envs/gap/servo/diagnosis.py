"""From servo logs to named causes: each joint by itself, then the whole arm as it is reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.diagnosis import NamedCause
from stiction_envs.gap.servo import contact
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.choose import Chooser, JointCauses, Question
from stiction_envs.gap.servo.findings import named_causes, verdict_of
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS
from stiction_envs.gap.servo.questions import (
    GRAVITY_SEEN,
    LEAST_GRAVITY,
    PLACEHOLDER,
    Servo,
    always_fitted,
    busiest,
    nominal_parameters,
    possible_causes,
    resolution_of,
    rest_noise,
    sags,
)
from stiction_envs.gap.servo.whole_arm import (
    ServoCheck,
    check_model,
    folds,
    held_out,
    nominal_angles,
    refit,
    rms,
    rows,
    touching,
)
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoDiagnosis:
    """What servo logs show about a simulation."""

    robot: str
    verdict: str
    causes: tuple[NamedCause, ...]
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
    touching: tuple[list[list[float]], ...]
    """Per log, the stretches that were left out [s]."""
    notes: tuple[str, ...]
    check: ServoCheck | None = None
    minor: tuple[NamedCause, ...] = ()

    @property
    def gain_percent(self) -> float:
        """100 (1 − mean over joints of extended over nominal error) [%]."""
        share = self.extended_rms / np.maximum(self.nominal_rms, 1e-12)
        return float(100.0 * (1.0 - share.mean())) if self.causes else 0.0

    def to_json(self) -> dict[str, Any]:
        """Return ``diagnosis.json``."""
        out: dict[str, Any] = {
            "robot": self.robot,
            "drive": "position",
            "verdict": self.verdict,
            "nominal": {"rms_rad": self.nominal_rms.tolist(), "held_out": True},
            "extended": {"rms_rad": self.extended_rms.tolist(), "held_out": True},
            "noise_floor_rad": self.noise.tolist(),
            "gain_percent": self.gain_percent,
            "minor": [
                {"name": c.name, "joints": list(c.joints), "gain_percent": c.gain_percent}
                for c in self.minor
            ],
            "causes": [c.to_json() for c in self.causes],
            "servo": {
                p.key: self.parameters[:, INDEX[name]].tolist() for name, p in PARAMETERS.items()
            },
            "notes": list(self.notes),
        }
        if self.check is not None:
            out["check"] = self.check.to_json()
        return out


class _Joints:
    """The joints of one arm along its logs, and what is asked about each."""

    def __init__(
        self, logs: Sequence[ServoLog], arm: Arm, servo: Servo, workers: ThreadPoolExecutor
    ) -> None:
        self.servo, self.workers = servo, workers
        self.motions = joint_motions(arm, logs)
        self.n = arm.n
        self.resolution = np.array([resolution_of(m.q) for m in self.motions])
        self.noise = np.maximum(
            self.resolution / np.sqrt(12.0), [rest_noise(m) for m in self.motions]
        )
        self.load = np.array([float(np.abs(m.gravity).mean()) for m in self.motions])
        self.nominal = nominal_parameters(servo, self.motions)
        self.scaled = [
            sags(m, float(r)) for m, r in zip(self.motions, self.resolution, strict=True)
        ]
        some = [busiest(m) for m in self.motions]
        # rows and segments on which each joint's causes are chosen
        self.shown = [
            np.repeat(k, np.diff(m.bounds)) for k, m in zip(some, self.motions, strict=True)
        ]
        self.chosen = [m.only(k) for m, k in zip(self.motions, some, strict=True)]
        self.notes: list[str] = []

    def question(self, j: int, counts: Rows) -> Question:
        """Return what is asked about a joint; ``counts`` are rows of those shown."""
        scaled = self.scaled[j]
        return Question(
            motion=self.chosen[j],
            nominal=self.nominal[j],
            always=always_fitted(self.servo, scaled),
            candidates=possible_causes(
                self.servo, self.chosen[j], float(self.resolution[j]), scaled
            ),
            counts=counts,
            noise=float(self.noise[j]),
            judged=not self.servo.perfect,
        )

    def contacts(self) -> dict[int, Rows]:
        """Return by joint the (T,) rows in which it seems to touch something."""

        def rough(j: int) -> Array:
            counts = ~contact.suspected(self.chosen[j])
            return self.chosen[j].q - Chooser(self.question(j, counts)).rough().angle

        out = {}
        for j, error in enumerate(self.workers.map(rough, range(self.n))):
            touches = contact.in_contact(self.chosen[j], error, float(self.resolution[j]))
            if touches.any():
                out[j] = np.zeros(len(self.shown[j]), dtype=bool)
                out[j][self.shown[j]] = touches
        many = bool(out) and np.any([*out.values()], axis=0).mean() > contact.MOST
        return {} if many else out

    def choose(self, free: Rows, say: Callable[[str, float], None]) -> dict[int, JointCauses]:
        """Return the causes of each joint; ``free`` are the (T,) rows without contact."""
        out: dict[int, JointCauses] = {}

        def one(j: int) -> JointCauses:
            found = Chooser(self.question(j, free[self.shown[j]])).choose()
            say("choosing causes", (len(out) + 1) / self.n)
            return found

        heavy = [j for j in range(self.n) if self.scaled[j] or not self.servo.perfect]
        light = [j for j in range(self.n) if j not in heavy]
        out |= dict(zip(heavy, self.workers.map(one, heavy), strict=True))
        if light:
            self._scale(light, [out[j].fit.parameters[INDEX["stiffness"]] for j in heavy])
            out |= dict(zip(light, self.workers.map(one, light), strict=True))
        return out

    def _scale(self, light: Sequence[int], stiffnesses: Sequence[float]) -> None:
        """Give joints that do not clearly sag the stiffness of the others, and say so."""
        stiffness = float(np.median(stiffnesses)) if stiffnesses else PLACEHOLDER
        for j in light:
            self.nominal[j, INDEX["stiffness"]] = stiffness
            # with the others' stiffness it may sag enough after all
            largest = float(np.abs(self.motions[j].gravity).max())
            seen = largest > GRAVITY_SEEN * self.resolution[j] * stiffness
            self.scaled[j] = bool(stiffnesses) and bool(seen) and largest > LEAST_GRAVITY
        without = [j for j in light if not self.scaled[j]]
        if without:
            same = self.servo.same and stiffnesses
            said = "taken from the other joints" if same else "unknown"
            self.notes.append(
                f"joints {', '.join(str(j + 1) for j in without)}: no gravity sets the scale of "
                f"their torques; servo stiffness {said}, set to {stiffness:.3g} N·m/rad, and "
                "friction, damping and limits scale with it"
            )

    def refits(self, found: dict[int, JointCauses], free: Rows) -> tuple[Array, list[Array]]:
        """Return (n, P) parameters fitted to all rows, and to each half of the time."""
        halves = folds(self.motions[0])

        def one(j: int, counts: Rows) -> Array:
            return refit(self.motions[j], found[j].fit.parameters, found[j].free, counts)

        fits = [
            self.workers.map(partial(one, counts=counts), range(self.n))
            for counts in (free, *(free & half for half in halves))
        ]
        final, *parts = (np.stack(list(x)) for x in fits)
        return final, parts


def diagnose_servo(
    logs: Sequence[ServoLog],
    arm: Arm,
    servo: Servo,
    *,
    check: Sequence[ServoLog] = (),
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
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
        joints = _Joints(logs, arm, servo, workers)
        say("columns of all causes", 0.0)
        contacts = joints.contacts()
        t = joints.motions[0].t
        free = ~np.any([np.zeros(len(t), dtype=bool), *contacts.values()], axis=0)
        found = joints.choose(free, say)
        say("refitting", 0.0)
        final, parts = joints.refits(found, free)
        say("forward validation", 0.0)
        jobs = [workers.submit(simulate_arm, arm, logs, p, joints.load, threads=1) for p in parts]
        plain = nominal_angles(arm, logs, servo, joints.nominal, joints.load)
        held = held_out(logs, joints.motions[0], [job.result() for job in jobs])
    q = rows(logs, [log.q for log in logs])
    nominal_rms = rms(q - rows(logs, plain), free)
    extended_rms = rms(q - rows(logs, held), free)
    causes, minor = named_causes(found, contacts, t, nominal_rms)
    checked = None
    if check:
        say("check", 0.0)
        checked = check_model(arm, check, servo, joints.nominal, final, joints.load, extended_rms)
    return ServoDiagnosis(
        robot=arm.name,
        verdict=verdict_of(causes, nominal_rms, extended_rms, joints.noise),
        causes=causes,
        minor=minor,
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        noise=joints.noise,
        parameters=final,
        load=joints.load,
        logs=tuple(logs),
        nominal_angles=tuple(plain),
        angles=tuple(held),
        touching=tuple(touching(logs, joints.motions[0], ~free)),
        notes=tuple(joints.notes),
        check=checked,
    )
