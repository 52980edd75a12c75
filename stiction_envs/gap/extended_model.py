"""Put causes into a model: friction that the plant loads, and plain MJCF for stock MuJoCo.

Controls of the MJCF are joint torques as in the logs. They include gravity, so the model does not
compensate it. What MuJoCo cannot represent is described, and given as torque along the logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel, link_inertia, mass_matrix
from stiction_envs.friction.parameters import (
    QUANTITIES,
    FrictionParameters,
    dump_friction,
    load_friction,
)
from stiction_envs.friction.servos import read_servos
from stiction_envs.friction.sticking import sticking_model, with_rotors
from stiction_envs.gap.causes import ModelDraft, cause_named
from stiction_envs.gap.causes.draft import LEAST_FRICTION
from stiction_envs.gap.extended_mjcf import TIMESTEP, mjcf_text, mjcf_tree
from stiction_envs.gap.model_file import Nominal, changed_arm, dump, nominal_of, read
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.robots import ARMS, Arm

Array = NDArray[np.float64]
LEAST_BRISTLE = 1.0
"""Stiffness of the softest bristle [N·m/rad]; assumed."""
MOST_DAMPED = 1.0
"""Largest damping ratio of a bristle in the model [-]; assumed."""
STIFFEST = 0.1
"""Largest bristle stiffness over inertia/timestep² [-]; assumed: a twentieth of the chattering
limit."""
FASTEST_DECAY = 0.5
"""Largest bristle damping over inertia/timestep [-]; assumed: up to four joints in line may stick,
and Euler is stable while their sum is below 2."""
BRISTLE_DAMPING_RATIO = 0.4
"""ζ of a bristle without a nominal or diagnosed one [-]; assumed."""
JOINT_DAMPING_RATIO = 0.15
"""ζ of a joint's spring without a nominal one [-]; assumed."""
POSES = 200
"""Number of poses of the logs at which the joints' inertia is computed [-]; assumed."""
_COMMENT = """ {name} as its logs show it, written by stiction diagnose. SI units.
     Controls are joint torques [N m] as in the logs: they carry gravity themselves, nothing is
     compensated here. Friction is a LuGre bristle in each dcmotor, rotor inertia is armature,
     viscous friction damping. Keep integrator Euler and a timestep of at most {timestep:g} s.
     Contacts are off. What was found and MuJoCo cannot express:
{missing} """


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A model with causes."""

    xml: str
    """Plain MJCF."""
    friction: FrictionParameters
    """For the plant."""
    sources: dict[str, str]
    """The source of each quantity of the friction."""
    nominal: Nominal
    """The exact causes, and their baseline."""
    missing: tuple[str, ...]
    """What MJCF cannot represent, one clause each."""
    friction_missing: tuple[str, ...]
    """What the friction tables cannot represent, one clause each."""
    left_out: Array
    """(T, n) torque of the causes that the MJCF leaves out, along the logs' motion [N·m]."""

    def toml(self, *, meta: dict[str, str], provenance: dict[str, str]) -> str:
        """Return ``model.toml``: friction tables, then the exact causes."""
        text = dump_friction(self.friction, sources=self.sources, meta=meta, provenance=provenance)
        head = "# A diagnosed arm. SI units; direction order is +, −. Written by stiction diagnose."
        lines = [head, *text.splitlines()[1:]]
        lines += ["", *(f"# not in these tables: {m}" for m in self.friction_missing)]
        return "\n".join(lines).rstrip("\n") + "\n" + dump(self.nominal)


def extend(data: Data, nominal: Nominal) -> Extension:
    """Put causes into a model.

    Args:
        data: logs against the model without the causes; they give the arm's poses and loads.
        nominal: the baseline of the causes, and the causes.

    Raises:
        StictionError: MuJoCo cannot represent the model.
    """
    arm, parts = data.arm, nominal.parts
    level = np.abs(data.rigid).mean(axis=0)
    duration = float(np.ptp(data.recording.since_session))
    draft = ModelDraft.of(nominal.friction, data.n, mean_load=level, duration=duration)
    causes = {p.cause: cause_named(p.cause) for p in parts}
    for part in sorted(parts, key=lambda p: causes[p.cause].contribution_order(p)):
        causes[part.cause].contribute(draft, part)
    loaded = changed_arm(arm, parts)
    friction, sources = _friction(draft, data, nominal.friction, loaded)
    plain = _for_mjcf(friction, draft, level)
    missing = tuple(dict.fromkeys(draft.not_in_mjcf))
    root, _ = mjcf_tree(loaded, plain, pull=draft.pull, offset=draft.offset, waves=draft.waves)
    left = np.zeros_like(data.q)
    for part in draft.left_out:
        cause = causes[part.cause]
        left += cause.torque(data, part)
        if (held := cause.held(draft, part, data)) is not None:
            left[:, part.joint - 1] -= held
    return Extension(
        xml=mjcf_text(loaded, root, _COMMENT, missing),
        friction=friction,
        sources=sources,
        nominal=nominal,
        missing=missing,
        friction_missing=tuple(dict.fromkeys(draft.not_in_tables)),
        left_out=left,
    )


def load_model(
    path: str | Path,
    robot: str | Path | None = None,
    *,
    payload: Sequence[float] | None = None,
    tilt: Sequence[float] | None = None,
    chain: Sequence[str] | None = None,
) -> StickingModel:
    """Return the arm of a ``model.toml`` with the payload, tilt and friction that were found.

    Every experiment accepts it as an arm: ``SingleJointExperiment(load_model(path))``.
    Torque behind the gear does not show rotor inertia. Joints without a diagnosed one take that of
    the robot's own friction (`with_rotors`); ``model.xml`` does not.

    Args:
        path: the file; with ``robot`` also a friction TOML, as `stiction calibrate` writes it.
        robot: name or model file; for other arms than the shipped ones the file must be given.
        payload: known mass [kg] and centre of mass x, y, z in the flange frame [m] of a mounted
            body; None for that of the diagnosis. What was found is added to it.
        tilt: known roll and pitch of the base [rad]; None as for ``payload``.
        chain: links at the base and the tip of the arm in a file of a bigger robot.

    Raises:
        StictionError: a file that is not a model, or an arm that cannot be loaded.
    """
    nominal = read(Path(path))
    if robot is None and nominal.robot in ARMS:
        robot = nominal.robot
    if robot is None:
        of = "holds no [arm]" if nominal.robot is None else f"is of robot {nominal.robot!r}"
        raise StictionError(f"{path}: {of}: expected robot=, its name or the path of its model")
    arm, _ = nominal_of(robot, nominal, payload=payload, tilt=tilt, chain=chain)
    if nominal.robot is None:
        return sticking_model(arm, path)
    nominal.check(arm, path)
    friction = with_rotors(load_friction(path, arm.n), arm)
    model = sticking_model(changed_arm(arm, nominal.parts), friction)
    return replace(model, servos=read_servos(Path(path), arm.n))


def _poses(data: Data) -> Array:
    """Return poses of the logs and the arm's rest pose, evenly selected."""
    step = max(1, len(data.q) // POSES)
    return np.vstack([data.arm.rest, data.q[::step]])


def _friction(
    draft: ModelDraft, data: Data, base: FrictionParameters | None, arm: Arm
) -> tuple[FrictionParameters, dict[str, str]]:
    """Return the friction and the source of each of its quantities."""

    def limited(text: str) -> None:
        draft.not_in_mjcf.append(text)
        draft.not_in_tables.append(text)

    coulomb = np.maximum(draft.coulomb, LEAST_FRICTION)
    stiction = np.maximum(draft.stiction, coulomb)
    for j in np.flatnonzero((draft.coulomb < 0).any(axis=1) | (draft.viscous < 0).any(axis=1)):
        limited(f"friction of joint {j + 1} came out negative: the model has zero")
    ratio = np.clip(coulomb / stiction, 1e-3, 1.0)
    rotor, elastic = np.maximum(draft.rotor, 0.0), np.isfinite(draft.spring)
    inertia = mass_matrix(arm, _poses(data)) + np.diag(np.where(elastic, 0.0, rotor))
    # in line with others (a stretched arm) a joint that sticks moves less than its own link
    free = np.min(1 / np.diagonal(np.linalg.inv(inertia), axis1=1, axis2=2), axis=0)
    carried = np.where(elastic, rotor, free)
    most = STIFFEST * carried / TIMESTEP**2
    distance = data.friction.presliding_distance
    soft = np.maximum(coulomb.mean(axis=1) / distance, LEAST_BRISTLE)
    bristle = np.where(np.isnan(draft.bristle), soft, draft.bristle)
    for j in np.flatnonzero(~np.isnan(draft.bristle) & (bristle > most)):
        limited(f"bristle of joint {j + 1}: {most[j]:.4g} N·m/rad is the stiffest that holds still")
    one = np.ones(data.n)
    values = {
        "load_low": 0.0 * one,
        "load_high": np.inf * one,
        "bristle_damping_ratio": BRISTLE_DAMPING_RATIO * one,
        "joint_damping_ratio": JOINT_DAMPING_RATIO * one,
        "load_coefficient": 0.0 * one,
        "warm_up_viscous": 0.0 * one,
        "gravity_error": 0.0 * one,
    }
    values |= {k: getattr(base, k) for k in QUANTITIES} if base is not None else {}
    # ours is a ratio to the critical damping of the inertia at the arm's rest pose; elsewhere the
    # bristle may carry many times as much
    at_rest = np.where(elastic, rotor, rotor + link_inertia(arm, arm.rest[None])[0])
    critical = 2 * np.sqrt(np.clip(bristle, 1e-3, most) * at_rest)
    most_damped = np.minimum(MOST_DAMPED, FASTEST_DECAY * carried / (TIMESTEP * critical))
    for j in np.flatnonzero(draft.damping > most_damped * critical):
        text = f"{most_damped[j] * critical[j]:.4g} N·m·s/rad is the most that a step can hold"
        limited(f"bristle damping of joint {j + 1}: {text}")
    damping = np.where(
        np.isnan(draft.damping), values["bristle_damping_ratio"], draft.damping / critical
    )
    values |= {
        "stiction": stiction,
        "coulomb_ratio": ratio,
        "stribeck_velocity": draft.stribeck,
        "viscous": np.maximum(draft.viscous, 0.0),
        # ours scales stiction, which contains Coulomb friction; the cause scales Coulomb friction
        "load_coefficient": values["load_coefficient"] + draft.load / ratio.mean(axis=1),
        "bristle_stiffness": np.clip(bristle, 1e-3, most),
        "bristle_damping_ratio": np.clip(damping, 0.0, most_damped),
        "rotor_inertia": rotor,
        "joint_stiffness": draft.spring,
        "ripple_amplitude": draft.ripple[:, 0],
        "ripple_periods": draft.ripple[:, 1],
        "ripple_phase": draft.ripple[:, 2],
        "warm_up_friction": draft.warm[:, 0],
        "warm_up_time": draft.warm[:, 1],
        "offset": draft.offset,
    }
    found = "stiction diagnose: nominal model and causes of [[cause]]"
    sources = dict.fromkeys(QUANTITIES, found)
    sources |= dict.fromkeys(
        ("bristle_damping_ratio", "joint_damping_ratio"), "assumed, or of the nominal model"
    )
    if np.isnan(draft.bristle).any():
        sources["bristle_stiffness"] = (
            "assumed where no presliding was found: Coulomb friction over a distance of "
            f"{float(distance.mean()):.2g} rad, softer where a step of 1 ms needs it"
        )
    return FrictionParameters(**values), sources


def _for_mjcf(friction: FrictionParameters, draft: ModelDraft, level: Array) -> FrictionParameters:
    """Return the friction half-way through the logs at their mean load, as MJCF represents it."""
    clipped = np.clip(level, friction.load_low, friction.load_high)
    stiction = friction.stiction + (friction.load_coefficient * clipped)[:, None]
    cold = np.exp(-draft.duration / (2 * friction.warm_up_time))  # half-way
    warm_up = 1.0 + friction.warm_up_friction * cold
    ripple = friction.ripple_amplitude > 0  # a ripple of no amplitude has no periods in MJCF
    return friction.replace(
        ripple_periods=np.where(ripple, friction.ripple_periods, 0.0),
        ripple_phase=np.where(ripple, friction.ripple_phase, 0.0),
        stiction=np.maximum(stiction * warm_up[:, None], LEAST_FRICTION),
        viscous=friction.viscous * (1.0 + friction.warm_up_viscous * cold)[:, None],
        load_coefficient=np.zeros_like(level),
        warm_up_friction=np.zeros_like(level),
        warm_up_viscous=np.zeros_like(level),
    )
