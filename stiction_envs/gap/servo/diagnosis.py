"""From servo logs to named causes: each joint by itself, then the whole arm as it is reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.diagnosis import NamedCause
from stiction_envs.gap.estimates import Estimate
from stiction_envs.gap.servo import contact
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.choose import LAG, LINKS_LEAVE, Chooser, JointCauses, Question
from stiction_envs.gap.servo.fit import fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS, absent
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
MOST_SECONDS = 240.0
"""Time of the logs on which causes are chosen [s]; segments beyond it only refine; assumed."""
MINOR = 0.06
"""Share of a joint's nominal error below which what a cause takes off is minor [-]; assumed."""
FOLD_SECONDS = 10.0
"""Length of the blocks of time that are held out in turn [s]; assumed."""
GRAVITY_SEEN = 3.0
"""Least sag of a joint by gravity over the angle's resolution that scales its servo's stiffness
[-]; assumed."""
LEAST_GRAVITY = 0.02
"""Largest gravity of a joint that counts as one without [N·m], as of `friction.model`; assumed."""
MOVES = 5.0
"""Least range of a joint's command over the resolution for it to be diagnosed [-]; assumed."""
PLACEHOLDER = 10.0
"""Stiffness of a servo of which nothing is known [N·m/rad]; assumed, and said."""

CLOSE = 3.0
"""Largest error over the noise floor that counts as explained [-], as for joint logs."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoCheck:
    """The model on logs that took no part."""

    nominal_rms: Array
    """(n,) [rad]."""
    extended_rms: Array
    """(n,) [rad]."""
    worse_joints: tuple[int, ...]

    @property
    def verdict(self) -> str:
        """``holds`` or ``does not hold``."""
        return "does not hold" if self.worse_joints else "holds"

    def to_json(self) -> dict[str, Any]:
        """Return the entry ``check``."""
        return {
            "nominal_rms_rad": self.nominal_rms.tolist(),
            "extended_rms_rad": self.extended_rms.tolist(),
            "verdict": self.verdict,
            "worse_joints": list(self.worse_joints),
            "not_transferring": [],
        }


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
    motions = joint_motions(arm, logs)
    resolution = np.array([_resolution(m.q) for m in motions])
    some = [_some(m) for m in motions]
    shown = [np.repeat(k, np.diff(m.bounds)) for k, m in zip(some, motions, strict=True)]
    chosen = [m.only(k) for m, k in zip(motions, some, strict=True)]
    noise = np.maximum(resolution / np.sqrt(12.0), [_rest_noise(m) for m in motions])
    known = _nominal(servo, motions)
    free = [servo.stiffness is None and servo.parameters is None] * arm.n
    scaled = np.array([_gravity_seen(m, r) for m, r in zip(motions, resolution, strict=True)])
    notes = []
    workers = ThreadPoolExecutor(max_workers=threads or None)
    done = 0

    def questions(of: Sequence[int], rows: Sequence[NDArray[np.bool_]]) -> list[Question]:
        return [
            Question(
                motion=chosen[j],
                nominal=known[j],
                always=_always(servo, scaled[j], free[j]),
                candidates=tuple(
                    c
                    for c in _candidates(chosen[j], resolution[j], scaled[j], free[j])
                    if c != "damping" or "damping" not in _always(servo, scaled[j], free[j])
                ),
                counts=rows[j],
                noise=float(noise[j]),
                judged=not free[j],
            )
            for j in of
        ]

    usual = [~contact.suspected(m) for m in chosen]
    say("columns of all causes", 0.0)
    first = list(workers.map(lambda q: Chooser(q).rough(), questions(range(arm.n), usual)))
    contacts: dict[int, NDArray[np.bool_]] = {}
    for j, found in enumerate(first):
        error = chosen[j].q - found.angle
        touches = contact.in_contact(chosen[j], error, float(resolution[j]))
        if touches.any():
            contacts[j] = np.zeros(len(shown[j]), dtype=bool)
            contacts[j][shown[j]] = touches
    free_rows = ~np.any([np.zeros(len(shown[0]), dtype=bool), *contacts.values()], axis=0)
    if free_rows.mean() < 1.0 - contact.MOST:
        free_rows[:], contacts = True, {}
    rows = [free_rows[k] for k in shown]

    def choose(q: Question) -> JointCauses:
        nonlocal done
        out = Chooser(q).choose()
        done += 1
        say("choosing causes", done / arm.n)
        return out

    heavy = [j for j in range(arm.n) if scaled[j] or not free[j]]
    light = [j for j in range(arm.n) if j not in heavy]
    results: dict[int, JointCauses] = {}
    results |= dict(zip(heavy, workers.map(choose, questions(heavy, rows)), strict=True))
    if light:
        stiffness = PLACEHOLDER
        if heavy:
            stiffness = float(
                np.median([results[j].fit.parameters[INDEX["stiffness"]] for j in heavy])
            )
        for j in light:
            known[j, INDEX["stiffness"]] = stiffness
            # with the others' stiffness it may sag enough after all
            largest = float(np.abs(motions[j].gravity).max())
            seen = largest > GRAVITY_SEEN * resolution[j] * stiffness
            scaled[j] = bool(heavy) and seen and largest > LEAST_GRAVITY
        unscaled = [j for j in light if not scaled[j]]
        if unscaled:
            said = "taken from the other joints" if servo.same and heavy else "unknown"
            notes.append(
                f"joints {', '.join(str(j + 1) for j in unscaled)}: no gravity sets the scale of "
                f"their torques; servo stiffness {said}, set to {stiffness:.3g} N·m/rad, and "
                "friction, damping and limits scale with it"
            )
        results |= dict(zip(light, workers.map(choose, questions(light, rows)), strict=True))
    say("refitting", 0.0)
    load = np.array([float(np.abs(m.gravity).mean()) for m in motions])
    parameters, folds = [], []
    for j in range(arm.n):
        r = results[j]
        task = partial(_refit, motions[j], r.fit.parameters, r.free)
        parameters.append(workers.submit(task, free_rows))
        folds.append([workers.submit(task, free_rows & f) for f in _folds(motions[j])])
    final = np.stack([p.result() for p in parameters])
    halves = [np.stack([f[k].result() for f in folds]) for k in range(2)]
    say("forward validation", 0.0)
    jobs = [workers.submit(simulate_arm, arm, logs, p, load, threads=1) for p in halves]
    plain = _nominal_angles(arm, logs, servo, known, motions, load)
    simulated = [job.result() for job in jobs]
    held = _held_out(logs, motions[0], simulated)
    q = np.concatenate([log.q[s] for log, s in _segments(logs)])
    keep = free_rows
    nominal_rms = _rms(q - _rows(logs, plain), keep)
    extended_rms = _rms(q - _rows(logs, held), keep)
    causes, minor = _named(results, contacts, motions[0].t, nominal_rms)
    checked = None
    if check:
        say("check", 0.0)
        checked = _check(arm, check, servo, known, final, load, extended_rms)
    workers.shutdown()
    return ServoDiagnosis(
        robot=arm.name,
        verdict=_verdict(causes, nominal_rms, extended_rms, noise),
        causes=causes,
        minor=minor,
        nominal_rms=nominal_rms,
        extended_rms=extended_rms,
        noise=noise,
        parameters=final,
        load=load,
        logs=tuple(logs),
        nominal_angles=tuple(plain),
        angles=tuple(held),
        touching=tuple(_touching(logs, motions[0], ~free_rows)),
        notes=tuple(notes),
        check=checked,
    )


# ---- what is asked ---------------------------------------------------------------------------


def _nominal(servo: Servo, motions: Sequence[JointMotion]) -> Array:
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


def _always(servo: Servo, scaled: bool, free: bool) -> tuple[str, ...]:
    """Return what is fitted and no cause: links that are a little off, damping nobody said."""
    out = ["compensation"] if scaled and not free else []
    if not free and servo.damping is None and servo.parameters is None:
        out.append("damping")
    return tuple(out)


def _candidates(
    motion: JointMotion, resolution: float, scaled: bool, free: bool
) -> tuple[str, ...]:
    """Return the causes that a motion could show."""
    if np.ptp(motion.command) < MOVES * resolution or np.ptp(motion.q) < MOVES * resolution:
        return ()
    out = ["servo_stiffness"] if scaled else []
    out += [*LAG, "coulomb_friction", "stribeck_friction", "presliding_hysteresis"]
    if scaled:
        out.append("load_dependent_friction")
        if not free:
            out += ["encoder_offset", "gravity_compensation_missing"]
    return (*out, "torque_limit", "speed_limit", "dead_zone")


def _gravity_seen(motion: JointMotion, resolution: float) -> bool:
    """Return whether the joint sags with gravity, so that gravity scales the servo's torque."""
    g, error = motion.gravity, motion.command - motion.q
    if np.abs(g).max() < LEAST_GRAVITY:
        return False
    sag = float(error @ g) / float(g @ g)
    return bool(sag * np.sqrt(np.mean(g**2)) > GRAVITY_SEEN * resolution)


def _resolution(q: Array) -> float:
    """Return the step of an encoder, or the smallest change that was logged [rad]."""
    steps = np.diff(np.unique(q))
    steps = steps[steps > 1e-9]
    return float(np.percentile(steps, 10)) if len(steps) else 1e-6


def _rest_noise(motion: JointMotion) -> float:
    """Return the noise of the angle while the command rests [rad]."""
    still = np.concatenate([[False], np.diff(motion.command) == 0.0])
    calm = np.convolve(still, np.ones(9), "same") >= 9
    jump = motion.q[1:-1] - 0.5 * (motion.q[:-2] + motion.q[2:])
    jump = jump[calm[1:-1]]
    return float(np.sqrt(np.mean(jump**2) / 1.5)) if len(jump) > 20 else 0.0


def _some(motion: JointMotion) -> NDArray[np.bool_]:
    """Return (S,) the segments on which a joint's causes are chosen: where it moves most."""
    parts = [slice(a, b) for a, b in pairwise(motion.bounds)]
    seconds = np.array([float(np.ptp(motion.t[p])) for p in parts])
    path = np.array([float(np.abs(np.diff(motion.command[p])).sum()) for p in parts])
    order = np.argsort(-path / np.maximum(seconds, 1e-9), kind="stable")
    keep = np.zeros(len(seconds), dtype=bool)
    keep[order[0]] = True
    keep[order[np.cumsum(seconds[order]) <= MOST_SECONDS]] = True
    return keep


# ---- refits and the whole arm ----------------------------------------------------------------


def _refit(
    motion: JointMotion, start: Array, free: Sequence[str], rows: NDArray[np.bool_]
) -> Array:
    return fit(motion, start, free, counts=rows, iterations=6).parameters


def _folds(motion: JointMotion) -> list[NDArray[np.bool_]]:
    """Return two halves of the rows, in alternating blocks of time."""
    segment = np.repeat(np.arange(len(motion.bounds) - 1), np.diff(motion.bounds))
    since = motion.t - motion.t[motion.bounds[segment]]
    even = (since // FOLD_SECONDS + segment) % 2 == 0
    return [even, ~even]


def _segments(logs: Sequence[ServoLog]) -> list[tuple[ServoLog, slice]]:
    return [(log, s) for log in logs for s in log.segments if s.stop - s.start > 1]


def _rows(logs: Sequence[ServoLog], angles: Sequence[Array]) -> Array:
    """Return the rows of all segments, as motions have them."""
    return np.concatenate(
        [a[s] for log, a in zip(logs, angles, strict=True) for _, s in _segments([log])]
    )


def _held_out(
    logs: Sequence[ServoLog], motion: JointMotion, halves: Sequence[Sequence[Array]]
) -> list[Array]:
    """Return per log the angles of the model that was fitted to the other half of the time."""
    of_first = _folds(motion)[0]
    out, k = [], 0
    for i, log in enumerate(logs):
        angle = halves[0][i].copy()
        for _, s in _segments([log]):
            m = s.stop - s.start
            mine = of_first[k : k + m]
            angle[s][mine] = halves[1][i][s][mine]
            k += m
        out.append(angle)
    return out


def _nominal_angles(
    arm: Arm,
    logs: Sequence[ServoLog],
    servo: Servo,
    nominal: Array,
    motions: Sequence[JointMotion],
    load: Array,
) -> list[Array]:
    if servo.stiffness is None and servo.parameters is None:
        return [log.q_cmd.copy() for log in logs]
    return simulate_arm(arm, logs, nominal, load, threads=1)


def _check(
    arm: Arm,
    logs: Sequence[ServoLog],
    servo: Servo,
    nominal: Array,
    parameters: Array,
    load: Array,
    fitted_rms: Array,
) -> ServoCheck:
    plain = _nominal_angles(arm, logs, servo, nominal, (), load)
    model = simulate_arm(arm, logs, parameters, load)
    q = np.concatenate([log.q[s] for log, s in _segments(logs)])
    all_rows = np.ones(len(q), dtype=bool)
    before = _rms(q - _rows(logs, plain), all_rows)
    after = _rms(q - _rows(logs, model), all_rows)
    worse = np.flatnonzero((after > 1.1 * before) & (after > fitted_rms))
    return ServoCheck(
        nominal_rms=before, extended_rms=after, worse_joints=tuple(int(j) + 1 for j in worse)
    )


def _rms(error: Array, rows: NDArray[np.bool_]) -> Array:
    out: Array = np.sqrt(np.nanmean(error[rows] ** 2, axis=0))
    return out


def _touching(
    logs: Sequence[ServoLog], motion: JointMotion, touched: NDArray[np.bool_]
) -> list[list[list[float]]]:
    out, k = [], 0
    for log in logs:
        found = []
        for _, s in _segments([log]):
            m = s.stop - s.start
            found += contact.stretches(log.t[s], touched[k : k + m])
            k += m
        out.append(found)
    return out


# ---- what is said ----------------------------------------------------------------------------

EVIDENCE = {
    "servo_stiffness": "the arm sags under gravity by its torque over {value}",
    "damping": "the angle follows the command late, the more the faster it moves",
    "armature": "the angle overshoots or lags where the command accelerates",
    "delay": "the angle repeats the command later by a constant time",
    "servo_lag": "the angle follows the command late",
    "coulomb_friction": "the joint stops short of its command, on the side from which it came",
    "stribeck_friction": "the joint needs more torque to start than to go on",
    "load_dependent_friction": "the joint stops shorter where gravity is larger",
    "presliding_hysteresis": "the angle gives before it slides",
    "torque_limit": "the joint falls behind large commands at a constant torque",
    "speed_limit": "the joint falls behind fast commands at a constant speed",
    "dead_zone": "the joint rests anywhere near its command",
    "encoder_offset": "gravity sags the joint as if it stood at another angle",
    "gravity_compensation_missing": "the arm sags less than its gravity asks for",
    "external_contact": "the joint stalls far from its command in some stretches only",
}
"""One sentence per cause that a person can check in the plot of angles."""


def _reported(cause: str, estimates: dict[str, Estimate], p: Array) -> dict[str, Estimate]:
    """Return the parameters of a cause under the names and in the units of the contract."""

    def scaled(e: Estimate, factor: float) -> Estimate:
        low, high = sorted((e.ci95[0] * factor, e.ci95[1] * factor))
        value = factor * float(e.value)  # type: ignore[arg-type]
        return Estimate(value=value, ci95=(low, high), on_bound=e.on_bound)

    drop, level = float(p[INDEX["drop"]]), float(p[INDEX["stiction"]])
    if cause == "coulomb_friction":
        return {"coulomb_nm": scaled(estimates["stiction"], 1.0 - drop)}
    if cause == "stribeck_friction":
        out = {"stribeck_velocity": estimates["stribeck_velocity"]}
        if "stiction" in estimates:
            out = {"stiction_nm": estimates["stiction"], **out}
        return out
    if cause == "presliding_hysteresis":
        e = estimates["bristle"]
        low, high = (level / max(x, 1e-6) for x in reversed(e.ci95))
        return {
            "bristle_stiffness": Estimate(
                value=level / float(e.value),  # type: ignore[arg-type]
                ci95=(low, high),
                on_bound=e.on_bound,
            )
        }
    names = [name for name, q in PARAMETERS.items() if q.cause == cause]
    out = {PARAMETERS[name].key: estimates[name] for name in names}
    if cause == "dead_zone":
        out = {k: scaled(e, 2.0) for k, e in out.items()}
    return out


def _named(
    results: dict[int, JointCauses],
    contacts: dict[int, NDArray[np.bool_]],
    t: Array,
    nominal_rms: Array,
) -> tuple[tuple[NamedCause, ...], tuple[NamedCause, ...]]:
    """Return the causes of all joints, strongest first, and those that help a little."""
    n = len(results)
    joints: dict[str, dict[int, float]] = {}
    for j, r in results.items():
        for cause, loss in r.causes.items():
            joints.setdefault(cause, {})[j] = loss / max(float(nominal_rms[j]), 1e-12)
    out = []
    for cause, of in joints.items():
        ordered = sorted(of, key=lambda j: -of[j])
        found = {
            j + 1: _reported(cause, results[j].estimates, results[j].fit.parameters)
            for j in ordered
        }
        value = next(iter(next(iter(found.values())).values()))
        confused = sorted({x for j in ordered for x in results[j].confused[cause]})
        out.append(
            NamedCause(
                name=cause,
                joints=tuple(sorted(j + 1 for j in of)),
                gain_percent=100.0 * min(1.0, sum(of.values()) / n),
                parameters=found,
                evidence=EVIDENCE[cause].format(value=f"{value.value:.3g} N·m/rad"),
                confused_with=tuple(confused),
            )
        )
    if contacts:
        spans = {j + 1: contact.stretches(t, rows) for j, rows in contacts.items()}
        out.append(
            NamedCause(
                name="external_contact",
                joints=tuple(sorted(spans)),
                gain_percent=0.0,
                parameters={
                    j: {"stretches_s": Estimate(value=s, ci95=s, on_bound=False)}  # type: ignore[arg-type]
                    for j, s in spans.items()
                },
                evidence=EVIDENCE["external_contact"],
                confused_with=("torque_limit",),
            )
        )
    out.sort(key=lambda c: -c.gain_percent)
    little = {c for c, of in joints.items() if max(of.values()) < MINOR}
    named = tuple(c for c in out if c.name not in little)
    return named, tuple(c for c in out if c.name in little)


def _verdict(causes: Sequence[NamedCause], nominal: Array, extended: Array, noise: Array) -> str:
    if not causes:
        return "no discrepancy" if (nominal < LINKS_LEAVE * noise).all() else "cannot tell"
    return "explained" if (extended < CLOSE * noise).all() else "partly explained"
