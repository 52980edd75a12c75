"""Findings of servo logs: causes by name with their parameters, and the verdict."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.gap.causes import Cause
from stiction_envs.gap.causes.body.payload import Payload
from stiction_envs.gap.judge.judgement import WIDTH, Estimate, NamedCause
from stiction_envs.gap.judge.search import NAMED
from stiction_envs.gap.servo import motion
from stiction_envs.gap.servo.causes import ServoLag, causes_of_joints, servo_cause
from stiction_envs.gap.servo.fit import Fit, Noise, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.joint_search import STEPS, JointFindings
from stiction_envs.gap.servo.servo_parameters import INDEX, LOW
from stiction_envs.gap.servo.servo_payload import Tip

CLEAN = 5.0
"""Largest error over the noise floor that links a little off leave [-]; assumed: simulated arms of
5 % scatter leave up to 7 (`hidden.servo_logs`)."""
CLOSE = 3.0
"""Held-out error over the noise floor below which nothing is left [-]; assumed."""
ACTS = 0.1
"""Least gravity of a body on a joint that it is named on, over its largest [-]; assumed."""


def _reported(cause: Cause) -> dict[str, tuple[tuple[str, ...], Callable[..., Array]]]:
    """Return the numbers of ``diagnosis.json``, each with the parameters on which it depends."""
    same = zip(cause.parameters, cause.servo.sizes, strict=False)
    return {p.name: ((name,), lambda x: x) for p, name in same} | {**cause.servo.reported}


def _estimates(cause: str, fit: Fit) -> dict[str, Estimate]:
    """Return the parameters of a cause with their 95 % intervals."""
    c, sd = fit.coordinates, np.linalg.inv(fit.precision)
    ends = (fit.z <= c.low) | (fit.z >= c.high)
    near = c.parameters(fit.z + 1e-4 * np.eye(len(fit.z)))
    out = {}
    for key, (names, of) in _reported(servo_cause(cause)).items():
        at = [INDEX[name] for name in names]
        value = float(of(*fit.parameters[at]))
        slope = (of(*near[:, at].T) - value) / 1e-4
        half = WIDTH * float(np.sqrt(slope @ sd @ slope))
        least = LOW[at[0]]
        out[key] = Estimate(
            value=value,
            ci95=(max(value - half, min(least, value)), value + half),
            on_bound=bool(ends[np.isin(c.at, at)].any()),
        )
    return out


def reported_columns(parameters: Array) -> dict[str, Array]:
    """Return (n,) each parameter of (n, P), under the names and in the units of the causes."""
    return {
        key: of(*(parameters[:, INDEX[name]] for name in names))
        for cause in causes_of_joints()
        for key, (names, of) in _reported(servo_cause(cause)).items()
    }


def _named(
    name: str,
    parameters: dict[int, dict[str, Estimate]],
    *,
    joints: Iterable[int],
    share: float = 0.0,
    nats: float = math.nan,
    rivals: Mapping[str, float] | None = None,
) -> NamedCause:
    """Return a cause with its words; ``joints`` are from 0, it takes a ``share`` off the error."""
    servo, rivals = servo_cause(name).servo, rivals or {}
    value = next(iter(next(iter(parameters.values())).values())).value
    below = servo.below_zero and np.less(value, 0.0)
    near = [rival for rival, x in rivals.items() if x < NAMED]
    return NamedCause(
        name=name,
        joints=tuple(sorted(j + 1 for j in joints)),
        gain_percent=100.0 * share,
        parameters=parameters,
        nats=nats,
        rivals=tuple(sorted(rivals.items(), key=lambda x: x[1])),
        evidence=(servo.below_zero if below else servo.evidence).format(value=value),
        confused_with=tuple(sorted({*servo.alike, *near})),
    )


def joint_causes(results: Mapping[int, JointFindings], nominal_rms: Array) -> list[NamedCause]:
    """Return the causes of joints (from 0)."""
    out = []
    for cause in dict.fromkeys(c for r in results.values() for c in r.causes):
        of = {j: r.causes[cause] for j, r in results.items() if cause in r.causes}
        share = {j: max(x.lost, 0.0) / max(float(nominal_rms[j]), 1e-12) for j, x in of.items()}
        found = {}
        for j in sorted(of, key=lambda j: -share[j]):
            lag = results[j].lag if cause == ServoLag.name else None
            found[j + 1] = _estimates(cause, lag or results[j].predicting)
        rivals: dict[str, float] = {}
        for name, nats in (rival for x in of.values() for rival in x.rivals):
            rivals[name] = min(nats, rivals.get(name, nats))
        whole = min(1.0, sum(share.values()) / len(nominal_rms))
        nats = sum(x.nats for x in of.values())
        out.append(_named(cause, found, joints=of, share=whole, nats=nats, rivals=rivals))
    return out


def contact(contacts: Mapping[int, Bools], t: Array) -> NamedCause:
    """Return the cause of the rows (T,) in which joints touch something."""
    found = {}
    for j, rows in contacts.items():
        spans: Any = motion.stretches(t, rows)
        found[j + 1] = {"stretches_s": Estimate(value=spans, ci95=spans, on_bound=False)}
    return _named("external_contact", found, joints=contacts)


def carried(tip: Tip, lost: Array, nominal_rms: Array, nats: float) -> NamedCause:
    """Return the cause of a body at the flange.

    ``lost`` (n,) is the error that the body takes off [rad], ``nats`` the log evidence against the
    arm without the body.
    """
    acts = np.flatnonzero(tip.torque > ACTS * tip.torque.max()).tolist()
    share = float(np.clip(lost / np.maximum(nominal_rms, 1e-12), 0.0, 1.0).mean())
    return _named(Payload.name, {0: tip.parameters}, joints=acts, share=share, nats=nats)


def verdict_of(causes: Sequence[NamedCause], nominal: Array, extended: Array, noise: Array) -> str:
    """Return the verdict; errors and noise floor are (n,) [rad]."""
    if not causes:
        return "no discrepancy" if (nominal < CLEAN * noise).all() else "cannot tell"
    return "explained" if (extended < CLOSE * noise).all() else "partly explained"


def refit(joint: JointMotion, found: JointFindings, counts: Bools) -> Array:
    """Return (P,) parameters of the same causes fitted to other rows of the joint's motion.

    Links that lean are no offset, which would move the links beyond, and those that are lighter no
    negative armature: such small errors are left as they are.
    """
    noise = Noise(joint, counts, found.noise.floor, found.noise.last)
    of = found.predicting.coordinates
    if "encoder_offset" not in found.causes:
        of = of.fixed(INDEX["offset"])
    of = replace(of, lowest=np.maximum(of.lowest, LOW))
    return fit(joint, noise, of, found.predicting.parameters[None], STEPS).parameters
