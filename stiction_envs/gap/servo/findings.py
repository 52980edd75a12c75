"""What is said of servo logs: causes by name with their parameters, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.judge.judgement import Estimate, NamedCause
from stiction_envs.gap.servo import contact
from stiction_envs.gap.servo.choose import LINKS_LEAVE, JointCauses
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS
from stiction_envs.gap.servo.payload import ACTS, Tip
from stiction_envs.gap.servo.spread import EXTRA_STICTION, SERVO_LAG

Array = NDArray[np.float64]
CLOSE = 3.0
"""Held-out error over the noise floor below which nothing is left [-]; assumed."""
EVIDENCE = {
    "servo_stiffness": "the arm sags under gravity by its torque over {value}",
    "damping": "the angle follows the command late, the more the faster it moves",
    "armature": "the angle overshoots or lags where the command accelerates",
    "delay": "the angle repeats the command later by a constant time",
    "servo_lag": "the angle follows the command late, by delay and damping over stiffness together",
    "coulomb_friction": "the joint stops short of its command, on the side from which it came",
    "stribeck_friction": "the joint needs more torque to start than to go on",
    "load_dependent_friction": "the joint stops shorter where gravity is larger",
    "presliding_hysteresis": "the angle gives before it slides",
    "torque_limit": "the joint falls behind large commands at a constant torque",
    "speed_limit": "the joint falls behind fast commands at a constant speed",
    "dead_zone": "the joint rests anywhere near its command",
    "encoder_offset": "gravity sags the joint as if it stood at another angle",
    "gravity_compensation_missing": "the arm sags less than its gravity asks for",
    "payload": "joints sag together, as under a body of {value} at the flange",
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
        return {
            "stiction_nm": estimates[EXTRA_STICTION],
            "stribeck_velocity": estimates["stribeck_velocity"],
        }
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
    if cause == SERVO_LAG:
        return {"lag_s": estimates[SERVO_LAG]}
    names = [name for name, q in PARAMETERS.items() if q.cause == cause]
    out = {PARAMETERS[name].key: estimates[name] for name in names}
    if cause == "dead_zone":
        out = {k: scaled(e, 2.0) for k, e in out.items()}
    return out


def reported_columns(parameters: Array) -> dict[str, Array]:
    """Return (n,) each parameter of (n, P), under the names and in the units of the causes."""
    out = {p.key: parameters[:, INDEX[name]] for name, p in PARAMETERS.items()}
    out["stiction_nm"] = out["coulomb_nm"] * out.pop("drop")
    out["coulomb_nm"] = out["coulomb_nm"] - out["stiction_nm"]
    out["width_rad"] = 2.0 * out["width_rad"]
    return out


def named_causes(
    results: dict[int, JointCauses],
    contacts: dict[int, NDArray[np.bool_]],
    t: Array,
    nominal_rms: Array,
) -> tuple[tuple[NamedCause, ...], tuple[NamedCause, ...]]:
    """Return the causes of all joints, strongest first, and those that help a little."""
    n = len(nominal_rms)
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
    little = {c for c, of in joints.items() if all(c in results[j].minor for j in of)}
    named = tuple(c for c in out if c.name not in little)
    return named, tuple(c for c in out if c.name in little)


def with_payload(
    causes: Sequence[NamedCause],
    tip: Tip,
    lost: Array,
    nominal_rms: Array,
) -> tuple[NamedCause, ...]:
    """Return the causes with a body at the flange among them.

    Args:
        causes: of the joints.
        tip: the body.
        lost: (n,) error that it takes off [rad].
        nominal_rms: (n,) [rad].
    """
    acts = tip.torque > ACTS * tip.torque.max()
    share = np.clip(lost / np.maximum(nominal_rms, 1e-12), 0.0, 1.0)
    body = NamedCause(
        name="payload",
        joints=tuple(int(j) + 1 for j in np.flatnonzero(acts)),
        gain_percent=100.0 * float(share.mean()),
        parameters={0: tip.parameters},
        evidence=EVIDENCE["payload"].format(value=f"{tip.mass:.3g} kg"),
        confused_with=(
            "encoder_offset",
            "gravity_compensation_missing",
            "link_parameters",
            "servo_stiffness",
        ),
    )
    return tuple(sorted([*causes, body], key=lambda c: -c.gain_percent))


def verdict_of(
    causes: Sequence[NamedCause],
    nominal: Array,
    extended: Array,
    noise: Array,
) -> str:
    """Return the verdict; errors and noise floor are (n,) [rad]."""
    if not causes:
        enough = LINKS_LEAVE * noise
        return "no discrepancy" if (nominal < enough).all() else "cannot tell"
    enough = CLOSE * noise
    return "explained" if (extended < enough).all() else "partly explained"
