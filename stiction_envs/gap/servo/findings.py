"""Findings of servo logs: causes by name with their parameters, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.judge.judgement import WIDTH, Estimate, NamedCause
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.servo import motion
from stiction_envs.gap.servo.fit import Fit, Noise, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.joint_search import STEPS, JointFindings
from stiction_envs.gap.servo.questions import SERVO_LAG
from stiction_envs.gap.servo.servo_parameters import HIGH, INDEX, LOW, PARAMETERS
from stiction_envs.gap.servo.servo_payload import Tip

Array = NDArray[np.float64]
CLEAN = 5.0
"""Largest error over the noise floor that links a little off leave [-]; assumed: simulated arms of
5 % scatter leave up to 7 (`hidden.servo_logs`)."""
CLOSE = 3.0
"""Held-out error over the noise floor below which nothing is left [-]; assumed."""
ACTS = 0.1
"""Least gravity of a body on a joint that it is named on, over its largest [-]; assumed."""
EVIDENCE = {
    "servo_stiffness": "the arm sags under gravity by its torque over {value}",
    "damping": "the angle follows the command late, the more the faster it moves",
    "armature": "the angle overshoots or lags where the command accelerates",
    "delay": "the angle repeats the command later by a constant time",
    "lead": "the angle comes before its command moves it: its stamps are late, or the controller "
    "adds kd · dq_cmd, so that the joint follows q_cmd + kd / kp · dq_cmd",
    "servo_lag": "the angle follows the command late, by delay and damping over stiffness together",
    "coulomb_friction": "the joint stops short of its command, on the side from which it came",
    "stribeck_friction": "the joint needs more torque to start than to go on",
    "load_dependent_friction": "the joint stops shorter where gravity is larger",
    "presliding_hysteresis": "the angle gives before it slides",
    "torque_limit": "the joint falls behind large commands at a constant torque",
    "speed_limit": "the joint falls behind fast commands at a constant speed",
    "dead_zone": "the joint rests anywhere near its command",
    "encoder_offset": "gravity sags the joint as if it stood at another angle",
    "gravity_compensation_missing": "the arm sags as if its controller added more or less gravity",
    "payload": "joints sag together, as under a body of {value} at the flange",
    "external_contact": "the joint stalls far from its command in some stretches only",
}
"""One sentence per cause that a person can check in the plot of angles; ``lead``: delay below 0."""
ALIKE = {
    "servo_stiffness": ("payload", "encoder_offset", "link_parameters"),
    "dead_zone": ("coulomb_friction",),
    "encoder_offset": ("torque_offset", "payload"),
    "gravity_compensation_missing": ("servo_stiffness", "payload"),
    "speed_limit": ("torque_limit",),
}
"""Causes that positions alone cannot tell apart, or only just, whatever the motion."""


@dataclass(frozen=True)
class Reported:
    """A number of ``diagnosis.json``, from the parameters of a joint."""

    cause: str
    key: str
    names: tuple[str, ...]
    """Parameters on which it depends."""
    of: Callable[..., Array]
    """Returns it from these, in their order; arrays are of any shape."""


REPORTED = (
    Reported("coulomb_friction", "coulomb_nm", ("stiction", "drop"), lambda f, s: f * (1 - s)),
    Reported("stribeck_friction", "stiction_nm", ("stiction", "drop"), lambda f, s: f * s),
    Reported(
        "presliding_hysteresis", "bristle_stiffness", ("stiction", "bristle"), lambda f, z: f / z
    ),
    Reported("dead_zone", "width_rad", ("dead_zone",), lambda x: 2.0 * x),
    Reported(SERVO_LAG, "lag_s", ("delay", "damping", "stiffness"), lambda t, d, k: t + d / k),
    *(
        Reported(p.cause, p.key, (name,), lambda x: x)
        for name, p in PARAMETERS.items()
        if name not in ("stiction", "drop", "bristle", "dead_zone")
    ),
)
"""All such numbers, under the names and in the units of `diagnosis.json`."""


def _estimates(cause: str, fit: Fit) -> dict[str, Estimate]:
    """Return the parameters of a cause with their 95 % intervals."""
    c, sd = fit.coordinates, np.linalg.inv(fit.precision)
    ends = (fit.z <= c.low) | (fit.z >= c.high)
    near = c.parameters(fit.z + 1e-4 * np.eye(len(fit.z)))
    out = {}
    for r in (r for r in REPORTED if r.cause == cause):
        at = [INDEX[name] for name in r.names]
        value = float(r.of(*fit.parameters[at]))
        slope = (r.of(*near[:, at].T) - value) / 1e-4
        half = WIDTH * float(np.sqrt(slope @ sd @ slope))
        least = PARAMETERS[r.names[0]].low
        out[r.key] = Estimate(
            value=value,
            ci95=(max(value - half, min(least, value)), value + half),
            on_bound=bool(ends[np.isin(c.at, at)].any()),
        )
    return out


def reported_columns(parameters: Array) -> dict[str, Array]:
    """Return (n,) each parameter of (n, P), under the names and in the units of the causes."""
    return {
        r.key: r.of(*(parameters[:, INDEX[name]] for name in r.names))
        for r in REPORTED
        if r.cause != SERVO_LAG
    }


def named_causes(
    results: Mapping[int, JointFindings],
    contacts: Mapping[int, NDArray[np.bool_]],
    t: Array,
    nominal_rms: Array,
) -> tuple[NamedCause, ...]:
    """Return the causes of all joints, strongest first."""
    n = len(nominal_rms)
    out = []
    for cause in dict.fromkeys(c for r in results.values() for c in r.causes):
        of = {j: r.causes[cause] for j, r in results.items() if cause in r.causes}
        share = {j: max(x.lost, 0.0) / max(float(nominal_rms[j]), 1e-12) for j, x in of.items()}
        found = {}
        for j in sorted(of, key=lambda j: -share[j]):
            lag = results[j].lag if cause == SERVO_LAG else None
            found[j + 1] = _estimates(cause, lag or results[j].predicting)
        rivals: dict[str, float] = {}
        for name, nats in (rival for x in of.values() for rival in x.rivals):
            rivals[name] = min(nats, rivals.get(name, nats))
        near = [name for name, nats in rivals.items() if nats < NAMED]
        value = next(iter(next(iter(found.values())).values()))
        seen = "lead" if cause == "delay" and np.less(value.value, 0.0) else cause
        out.append(
            NamedCause(
                name=cause,
                joints=tuple(sorted(j + 1 for j in of)),
                gain_percent=100.0 * min(1.0, sum(share.values()) / n),
                parameters=found,
                nats=sum(x.nats for x in of.values()),
                rivals=tuple(sorted(rivals.items(), key=lambda x: x[1])),
                evidence=EVIDENCE[seen].format(value=f"{value.value:.3g} N·m/rad"),
                confused_with=tuple(sorted({*ALIKE.get(cause, ()), *near})),
            )
        )
    if contacts:
        stretches: dict[int, dict[str, Estimate]] = {}
        for j, rows in contacts.items():
            spans: Any = motion.stretches(t, rows)
            stretches[j + 1] = {"stretches_s": Estimate(value=spans, ci95=spans, on_bound=False)}
        out.append(
            NamedCause(
                name="external_contact",
                joints=tuple(sorted(stretches)),
                gain_percent=0.0,
                parameters=stretches,
                evidence=EVIDENCE["external_contact"],
                confused_with=("torque_limit",),
            )
        )
    return tuple(sorted(out, key=lambda c: -c.gain_percent))


def with_payload(
    causes: Sequence[NamedCause], tip: Tip, lost: Array, nominal_rms: Array, nats: float
) -> tuple[NamedCause, ...]:
    """Return the causes with a body at the flange among them.

    ``lost`` (n,) is the error that the body takes off [rad], ``nats`` the log evidence against the
    arm without the body.
    """
    acts = tip.torque > ACTS * tip.torque.max()
    share = np.clip(lost / np.maximum(nominal_rms, 1e-12), 0.0, 1.0)
    body = NamedCause(
        name="payload",
        joints=tuple(int(j) + 1 for j in np.flatnonzero(acts)),
        gain_percent=100.0 * float(share.mean()),
        parameters={0: tip.parameters},
        nats=nats,
        evidence=EVIDENCE["payload"].format(value=f"{tip.mass:.3g} kg"),
        confused_with=(
            "encoder_offset",
            "gravity_compensation_missing",
            "link_parameters",
            "servo_stiffness",
        ),
    )
    return tuple(sorted([*causes, body], key=lambda c: -c.gain_percent))


def verdict_of(causes: Sequence[NamedCause], nominal: Array, extended: Array, noise: Array) -> str:
    """Return the verdict; errors and noise floor are (n,) [rad]."""
    if not causes:
        return "no discrepancy" if (nominal < CLEAN * noise).all() else "cannot tell"
    return "explained" if (extended < CLOSE * noise).all() else "partly explained"


def refit(joint: JointMotion, found: JointFindings, counts: NDArray[np.bool_]) -> Array:
    """Return (P,) parameters of the same causes fitted to other rows of the joint's motion.

    Links that lean are no offset, which would move the links beyond, and those that are lighter no
    negative armature: such small errors are left as they are.
    """
    noise = Noise.of(joint, counts, found.noise.floor, found.noise.last)
    of = found.predicting.coordinates
    if "encoder_offset" not in found.causes:
        of = of.fixed(INDEX["offset"])
    low = np.maximum(of.parameters(of.low[None])[0], LOW)
    of = of.within(low[of.at], HIGH[of.at])
    return fit(joint, noise, of, found.predicting.parameters[None], STEPS).parameters
