"""Causes into a model: friction the plant loads, and plain MJCF that runs in stock MuJoCo.

Controls of the MJCF are joint torques as in the logs: they carry gravity themselves, so nothing is
compensated there. What MuJoCo cannot express is said in words, and as torque along the logs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import link_inertia
from stiction_envs.friction.parameters import (
    QUANTITIES,
    FrictionParameters,
    dump_friction,
    load_friction,
)
from stiction_envs.gap.extended_mjcf import (
    PAYLOAD_RADIUS,
    TIMESTEP,
    Body,
    with_bodies,
    write_mjcf,
)
from stiction_envs.gap.model_file import Nominal, Part, dump, read
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
LEAST_FRICTION = 1e-6
"""Dry friction of a joint that has none [N·m]: the least that our friction allows."""
STRIBECK = 0.05
"""Stribeck velocity where none was found; it does nothing there [rad/s]; assumed."""
LEAST_BRISTLE = 1.0
"""Softest bristle that is assumed [N·m/rad]."""
MOST_DAMPED = 1.0
"""Largest damping ratio of a bristle that is carried over [-]; assumed."""
STIFFEST = 0.1
"""Bristle stiffness over inertia/timestep² at most [-]: a twentieth of what chatters."""
LEAST_ROTOR = 0.01
"""Least rotor inertia that can carry a joint's friction in front of a spring [kg·m²]; assumed."""
LATE = 5.0
"""Time constant over the record's length by which a straight drift is written [-]; assumed."""
LEAST_MASS = 1e-3
"""Of a payload [kg]."""
POSES = 200
"""Poses of the logs in which the inertia of joints is looked up."""


@dataclass(eq=False)
class _Work:
    """What the causes are gathered in; (n,) or (n, 2) by direction."""

    coulomb: Array
    stiction: Array
    stribeck: Array
    viscous: Array
    load: Array
    """Of what was found only: Coulomb friction per N·m."""
    bristle: Array
    damping: Array
    """σ1 that was found [N·m·s/rad]; NaN where none was."""
    rotor: Array
    spring: Array
    offset: Array
    ripple: Array
    """(n, 3) amplitude, periods, phase of MuJoCo's cogging."""
    warm: Array
    """(n, 2) relative rise and time constant."""
    pull: Array
    """(n, 2) stiffness and rest angle of a spring to the world."""
    gravity: Array
    """(2,) part of gravity towards x and y [-]."""
    payloads: list[Body] = field(default_factory=list)
    friction_missing: list[str] = field(default_factory=list)
    """What the plant's friction cannot say."""
    missing: list[str] = field(default_factory=list)
    """What MJCF cannot say."""
    left: list[Part] = field(default_factory=list)
    """Causes that MJCF leaves out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A model with causes."""

    xml: str
    """Plain MJCF."""
    friction: FrictionParameters
    """For the plant."""
    sources: dict[str, str]
    """Of each quantity of the friction."""
    nominal: Nominal
    """The exact record."""
    missing: tuple[str, ...]
    """What the MJCF cannot say, one clause each."""
    friction_missing: tuple[str, ...]
    """What the friction tables cannot say, one clause each."""
    left_out: Array
    """(T, n) torque of the causes that the MJCF leaves out, along the logs' motion [N·m]."""

    def toml(self, *, meta: dict[str, str], provenance: dict[str, str]) -> str:
        """Return ``model.toml``: friction tables, then the record."""
        text = dump_friction(self.friction, sources=self.sources, meta=meta, provenance=provenance)
        head = "# A diagnosed arm. SI units; direction order is +, −. Written by stiction diagnose."
        lines = [head, *text.splitlines()[1:]]
        lines += ["", *(f"# not in these tables: {m}" for m in self.friction_missing)]
        return "\n".join(lines).rstrip("\n") + "\n" + dump(self.nominal)


def extend(data: Data, nominal: Nominal) -> Extension:
    """Put causes into a model.

    Args:
        data: logs beside the model without the causes; says where the arm was and how loaded.
        nominal: what the causes stand on, and the causes.

    Raises:
        StictionError: MuJoCo cannot hold the model.
    """
    arm, parts = data.arm, nominal.parts
    w = _start(data, nominal.friction)
    for part in _strongest_first(parts):
        _add(w, part, data)
    inertia = np.min(link_inertia(arm, _poses(data)), axis=0)
    friction, sources = _friction(w, data, nominal.friction, inertia)
    loaded = with_bodies(arm, w.payloads, w.gravity)
    level = np.abs(data.rigid).mean(axis=0)
    plain = _for_mjcf(friction, w, level)
    xml = write_mjcf(
        loaded, plain, pull=w.pull, offset=w.offset, missing=tuple(dict.fromkeys(w.missing))
    )
    left = np.zeros_like(data.q)
    for part in w.left:
        left += part.torque(data)
        j = part.joint - 1
        if part.cause == "load_dependent_friction":  # but for what the MJCF holds of it
            left[:, j] -= part.coefficients[0] * level[j] * data.smooth(data.direction(j))
        elif part.cause == "warm_up_drift" and w.warm[j, 0] != 0:
            middle = float(np.ptp(data.t)) / 2
            left[:, j] -= part.coefficients[0] * middle * data.smooth(data.direction(j))
    return Extension(
        xml=xml,
        friction=friction,
        sources=sources,
        nominal=nominal,
        missing=tuple(dict.fromkeys(w.missing)),
        friction_missing=tuple(dict.fromkeys(w.friction_missing)),
        left_out=left,
    )


def extended_nominal(path: str | Path, data: Data) -> Array:
    """Return (T, n) torque [N·m] of a ``model.toml`` along logs beside the model it stands on.

    Raises:
        StictionError: a file that is no record, or is of another arm.
    """
    nominal = read(Path(path))
    nominal.check(data.arm)
    return nominal.extend(data).nominal


def load_extended(
    path: str | Path, robot: str | Path | None = None
) -> tuple[Arm, FrictionParameters]:
    """Return arm (with the payload and tilt that were found) and friction of a ``model.toml``.

    Args:
        path: the file.
        robot: model file of the arm where it is none of ours.

    Raises:
        StictionError: a file that is no record, or an arm that cannot be loaded.
    """
    nominal = read(Path(path))
    if nominal.robot is None:
        raise StictionError(f"{path}: holds no [arm]: allowed is a model.toml of stiction diagnose")
    arm = load_arm(robot or nominal.robot, payload=nominal.payload, tilt=nominal.tilt)
    nominal.check(arm)
    payloads, gravity = [], np.zeros(2)
    for part in nominal.parts:
        if part.cause == "base_tilt":
            gravity += _lean(part)
        elif part.cause == "payload" and (load := _payload(part)) is not None:
            payloads.append(load)
    return with_bodies(arm, payloads, gravity), load_friction(Path(path), arm.n)


def _poses(data: Data) -> Array:
    """Return poses of the logs and the arm's rest, spread evenly."""
    step = max(1, len(data.q) // POSES)
    return np.vstack([data.arm.rest, data.q[::step]])


def _start(data: Data, base: FrictionParameters | None) -> _Work:
    n = data.n
    none = np.zeros((n, 2))
    w = _Work(
        coulomb=none.copy() if base is None else base.stiction * base.coulomb_ratio,
        stiction=none.copy() if base is None else base.stiction.copy(),
        stribeck=none + STRIBECK if base is None else base.stribeck_velocity.copy(),
        viscous=none.copy() if base is None else base.viscous.copy(),
        load=np.zeros(n),
        bristle=np.full(n, np.nan) if base is None else base.bristle_stiffness.copy(),
        damping=np.full(n, np.nan),
        rotor=np.zeros(n) if base is None else base.rotor_inertia.copy(),
        spring=np.full(n, np.inf) if base is None else base.joint_stiffness.copy(),
        offset=np.zeros(n) if base is None else base.offset.copy(),
        ripple=np.tile([0.0, 1.0, 0.0], (n, 1)),
        warm=np.tile([0.0, 1200.0], (n, 1)),
        pull=none.copy(),
        gravity=np.zeros(2),
    )
    if base is not None:
        w.ripple = np.stack([base.ripple_amplitude, base.ripple_periods, base.ripple_phase], axis=1)
        w.warm = np.stack([base.warm_up_friction, base.warm_up_time], axis=1)
    return w


def _strongest_first(parts: tuple[Part, ...]) -> list[Part]:
    """Return parts with ripples by their size: a joint's first one is what MuJoCo takes."""
    ripple = [p for p in parts if p.cause == "position_dependent_friction"]
    ripple.sort(key=lambda p: -float(np.hypot(p.coefficients[0], p.coefficients[1])))
    drift = [p for p in parts if p.cause == "warm_up_drift"]  # needs the level it drifts from
    first = [p for p in parts if p not in ripple and p not in drift]
    return [*first, *ripple, *drift]


def _add(w: _Work, part: Part, data: Data) -> None:
    """Put one cause where the model has room for it."""
    if part.joint == 0:
        _arm_wide(w, part)
    else:
        _of_joint(w, part, data)


def _leave(w: _Work, part: Part, why: str, *, tables: bool = True) -> None:
    where = "the arm" if part.joint == 0 else f"joint {part.joint}"
    w.missing.append(f"{part.cause} of {where}: {why}")
    if tables:
        w.friction_missing.append(f"{part.cause} of {where}: {why}")
    w.left.append(part)


def _arm_wide(w: _Work, part: Part) -> None:
    if part.cause == "base_tilt":
        w.gravity += _lean(part)
        w.friction_missing.append("base_tilt: in [[cause]] and model.xml")
    elif part.cause == "payload" and (load := _payload(part)) is not None:
        w.payloads.append(load)
        w.friction_missing.append("payload: in [[cause]] and model.xml")
        if load.inertia is None:
            w.missing.append(
                "payload: the inertia that was found is no body's, so that of a solid sphere of "
                f"{PAYLOAD_RADIUS:g} m stands in (assumed)"
            )
    elif part.cause == "actuator_delay":
        what = "send torques" if part.coefficients[0] >= 0 else "take measured torques as of"
        behind = ", which come behind a low-pass" if len(part.shape) > 1 else ""
        _leave(w, part, f"{what} {part.values()['delay_s']:.4g} s earlier{behind}")
    else:
        _leave(w, part, "not a body or a gravity that MuJoCo allows")


def _lean(part: Part) -> Array:
    """Return the part of gravity towards x and y [-]."""
    lean, azimuth = part.values()["tilt_rad"], part.values()["azimuth_rad"]
    return np.sin(lean) * np.array([np.cos(azimuth), np.sin(azimuth)])


def _payload(part: Part) -> Body | None:
    """Return a payload with a mass that counts."""
    mass, com = float(part.values()["mass_kg"]), np.array(part.values()["com_m"], float)
    return Body(mass, com, _inertia(part, mass, com)) if mass > LEAST_MASS else None


def _inertia(part: Part, mass: float, com: Array) -> Array | None:
    """Return the (3, 3) inertia of a payload about its centre of mass, if a body can have it."""
    if len(part.coefficients) != 10:
        return None
    xx, xy, yy, xz, yz, zz = part.coefficients[4:]
    about_flange = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    own = about_flange - mass * (com @ com * np.eye(3) - np.outer(com, com))
    a, b, c = np.linalg.eigvalsh(own)
    return own if a > 1e-9 and a + b >= c else None


def _of_joint(w: _Work, part: Part, data: Data) -> None:
    j, v = part.joint - 1, part.values()
    match part.cause:
        case "coulomb_friction":
            w.coulomb[j] += v["coulomb_nm"]
            w.stiction[j] += v["coulomb_nm"]
        case "direction_asymmetry":
            both = np.array([v["asymmetry_nm"], -v["asymmetry_nm"]])
            w.coulomb[j] += both
            w.stiction[j] += both
            _leave(w, part, "MuJoCo's friction knows no direction: the mean stands", tables=False)
        case "stribeck_friction":
            w.stiction[j] += v["stiction_nm"]
            w.stribeck[j] = v["stribeck_velocity"]
        case "viscous_friction":
            w.viscous[j] += v["viscous_nms"]
        case "load_dependent_friction":
            w.load[j] += v["load_coefficient"]
            _leave(w, part, "the level at the logs' mean load stands", tables=False)
        case "presliding_hysteresis":
            w.bristle[j] = v["bristle_stiffness"]
            w.damping[j] = part.coefficients[1] or np.nan
        case "torque_offset":
            w.offset[j] += v["offset_nm"]
        case "link_inertia":
            w.rotor[j] += v["armature_kgm2"]
            if w.rotor[j] < 0:
                _leave(w, part, f"{v['armature_kgm2']:+.4g} kg·m²: a rotor's is not negative")
                w.rotor[j] -= v["armature_kgm2"]
        case "joint_elasticity":
            if w.rotor[j] >= LEAST_ROTOR and not np.isfinite(w.spring[j]):
                w.spring[j] = max(1.0, v["stiffness_nm_per_rad"])
            else:
                _leave(w, part, "no rotor inertia is known that could swing on the spring")
        case "position_dependent_friction":
            if len(part.shape) > 1:
                _leave(w, part, "MuJoCo's ripple does not turn with the motion")
            elif w.ripple[j, 0] > 0:
                _leave(w, part, "MuJoCo has room for one ripple per joint, a stronger one stands")
            else:  # MuJoCo's cogging drives the joint; ours is what the motor must overcome
                w.ripple[j] = v["ripple_nm"], v["periods_per_rev"], v["phase_rad"] + np.pi
        case "external_spring":
            k, rest = v["stiffness_nm_per_rad"], v["rest_rad"]
            total = w.pull[j, 0] + k
            if k > 1e-8:
                w.pull[j] = total, (w.pull[j, 0] * w.pull[j, 1] + k * rest) / total
            w.friction_missing.append(f"external_spring of joint {j + 1}: in model.xml")
        case "warm_up_drift":
            _drift(w, part, data)
        case "torque_scale":
            _leave(w, part, f"divide the logged torque by {v['scale']:.4g}")
        case _:
            _leave(w, part, "MuJoCo's joints have no such thing")


def _drift(w: _Work, part: Part, data: Data) -> None:
    """Write a straight drift as the start of a slow exponential, if friction stays positive."""
    j, rate = part.joint - 1, float(part.coefficients[0])
    late = LATE * float(np.ptp(data.t))
    level = float(w.coulomb[j].mean())
    warm = level + rate * late
    rise = -rate * late / warm if warm > LEAST_FRICTION < level else -1.0
    ok = rise > -0.9 and w.warm[j, 0] == 0
    when = "mid-record" if ok else "the start of the record"
    _leave(w, part, f"MJCF has no clock: the level at {when} stands", tables=not ok)
    if ok:
        w.warm[j] = rise, late
        w.coulomb[j] *= warm / level
        w.stiction[j] *= warm / level


def _friction(
    w: _Work, data: Data, base: FrictionParameters | None, inertia: Array
) -> tuple[FrictionParameters, dict[str, str]]:
    """Return the friction and the source of each of its quantities."""
    coulomb = np.maximum(w.coulomb, LEAST_FRICTION)
    stiction = np.maximum(w.stiction, coulomb)
    for j in np.flatnonzero((w.coulomb < 0).any(axis=1) | (w.viscous < 0).any(axis=1)):
        text = f"friction of joint {j + 1} came out negative: zero stands"
        w.missing.append(text)
        w.friction_missing.append(text)
    ratio = np.clip(coulomb / stiction, 1e-3, 1.0)
    carried = np.where(np.isfinite(w.spring), w.rotor, w.rotor + inertia)
    most = STIFFEST * carried / TIMESTEP**2
    soft = np.maximum(coulomb.mean(axis=1) / data.distance, LEAST_BRISTLE)
    bristle = np.where(np.isnan(w.bristle), soft, w.bristle)
    for j in np.flatnonzero(~np.isnan(w.bristle) & (bristle > most)):
        text = f"bristle of joint {j + 1}: {most[j]:.4g} N·m/rad is the stiffest that holds still"
        w.missing.append(text)
        w.friction_missing.append(text)
    values = {k: getattr(base, k) for k in QUANTITIES} if base is not None else {}
    zero, one = np.zeros(data.n), np.ones(data.n)
    defaults = {
        "load_low": zero,
        "load_high": zero + np.inf,
        "bristle_damping_ratio": 0.4 * one,
        "joint_damping_ratio": 0.15 * one,
        "warm_up_viscous": zero,
        "gravity_error": zero,
    }
    values = {**defaults, **values}
    # ours is a ratio to the critical damping of what the bristle carries
    critical = 2 * np.sqrt(np.clip(bristle, 1e-3, most) * carried)
    damping = np.where(np.isnan(w.damping), values["bristle_damping_ratio"], w.damping / critical)
    values |= {
        "stiction": stiction,
        "coulomb_ratio": ratio,
        "stribeck_velocity": w.stribeck,
        "viscous": np.maximum(w.viscous, 0.0),
        # ours grows stiction, of which Coulomb friction is a part; the cause is of Coulomb's
        "load_coefficient": values.get("load_coefficient", zero) + w.load / ratio.mean(axis=1),
        "bristle_stiffness": np.clip(bristle, 1e-3, most),
        "bristle_damping_ratio": np.clip(damping, 0.0, MOST_DAMPED),
        "rotor_inertia": np.maximum(w.rotor, 0.0),
        "joint_stiffness": w.spring,
        "ripple_amplitude": w.ripple[:, 0],
        "ripple_periods": w.ripple[:, 1],
        "ripple_phase": w.ripple[:, 2],
        "warm_up_friction": w.warm[:, 0],
        "warm_up_time": w.warm[:, 1],
        "offset": w.offset,
    }
    found = "stiction diagnose: nominal model and causes of [[cause]]"
    sources = dict.fromkeys(QUANTITIES, found)
    sources |= dict.fromkeys(
        ("bristle_damping_ratio", "joint_damping_ratio"), "assumed, or of the nominal model"
    )
    if np.isnan(w.bristle).any():
        sources["bristle_stiffness"] = (
            "assumed where no presliding was found: Coulomb friction over a distance of "
            f"{float(data.distance.mean()):.2g} rad, softer where a step of 1 ms needs it"
        )
    return FrictionParameters(**values), sources


def _for_mjcf(friction: FrictionParameters, w: _Work, level: Array) -> FrictionParameters:
    """Return the friction at mid-record and at the logs' mean load, which MJCF then holds."""
    clipped = np.clip(level, friction.load_low, friction.load_high)
    stiction = friction.stiction + (friction.load_coefficient * clipped)[:, None]
    late = np.exp(-1 / (2 * LATE))  # half the record
    drifting = np.isclose(w.warm[:, 1], friction.warm_up_time) & (w.warm[:, 0] != 0)
    factor = np.where(drifting, 1.0 + w.warm[:, 0] * late, 1.0)
    ripple = friction.ripple_amplitude > 0  # what has no size has no periods in MJCF
    return friction.replace(
        ripple_periods=np.where(ripple, friction.ripple_periods, 0.0),
        ripple_phase=np.where(ripple, friction.ripple_phase, 0.0),
        stiction=np.maximum(stiction * factor[:, None], LEAST_FRICTION),
        load_coefficient=np.zeros_like(level),
        warm_up_friction=np.zeros_like(level),
    )
