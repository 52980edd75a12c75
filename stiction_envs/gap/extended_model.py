"""Put causes into a model: friction that the plant loads, and plain MJCF for stock MuJoCo.

Controls of the MJCF are joint torques as in the logs. They include gravity, so the model does not
compensate it. What MuJoCo cannot represent is described, and given as torque along the logs.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.errors import StictionError
from stiction_envs.friction import export
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import (
    QUANTITIES,
    FrictionParameters,
    dump_friction,
    load_friction,
)
from stiction_envs.friction.servos import read_servos
from stiction_envs.friction.steady import steady
from stiction_envs.friction.sticking import sticking_model, with_rotors
from stiction_envs.gap.causes import ModelDraft, Part, cause_named, registered
from stiction_envs.gap.causes.base import torque_of
from stiction_envs.gap.causes.draft import LEAST_FRICTION
from stiction_envs.gap.model_file import Nominal, changed_arm, dump, nominal_of, read
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.robots import ARMS, Arm, mjcf

TIMESTEP = 1e-3
"""Time step of the model [s]; assumed."""
LEAST_BRISTLE = 1.0
"""Stiffness of the softest bristle [N·m/rad]; assumed."""
MOST_ASYMMETRY = 0.9
"""Most that a direction's dry friction differs from the mean, over it [-]; assumed: beyond 1 it
would drive the joint."""
NEGATIVE = "friction of joint {j} came out negative: the model has zero"
ASYMMETRIC = "asymmetry of joint {j}: nine tenths of its Coulomb friction, more would drive it"
LIGHTER = "friction of joint {j} came out falling with load: the model's does not"
FALLING = "joint {j}: friction at rest came out below that in motion: the model has them equal"
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
    servo: str = ""
    """The table ``[servo]`` of an arm under position servos."""

    def toml(self, *, meta: dict[str, str], provenance: dict[str, str]) -> str:
        """Return ``model.toml``: friction tables, the exact causes, and position servos."""
        text = dump_friction(self.friction, sources=self.sources, meta=meta, provenance=provenance)
        head = "# A diagnosed arm. SI units; direction order is +, −. Written by stiction diagnose."
        lines = [head, *text.splitlines()[1:]]
        lines += ["", *(f"# not in these tables: {m}" for m in self.friction_missing)]
        return "\n".join(lines).rstrip("\n") + "\n" + dump(self.nominal) + self.servo


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
    if nominal.friction is None:
        draft.values["rotor_inertia"] += arm.stated.armature
    elif nominal.file:
        draft.values["bristle_stiffness"][arm.stated.bristle == 0] = np.nan  # frictionloss has none
    draft.pull += np.stack([arm.stated.stiffness, arm.stated.springref], axis=1)
    order = [c.name for c in registered()]  # drift needs the level that it drifts from

    def turn(part: Part) -> tuple[int, int, float]:
        """Return a sort key: causes as registered, level by level, strongest first."""
        of_cause = order.index(part.cause) if part.cause in order else len(order)
        return of_cause, part.level, -float(np.linalg.norm(part.coefficients))

    for part in sorted(parts, key=turn):
        cause_named(part.cause).contribute(draft, part)
    loaded = changed_arm(arm, parts)
    friction, sources = _friction(draft, data, loaded)
    plain = _for_mjcf(friction, draft)
    missing = tuple(dict.fromkeys(draft.not_in_mjcf))
    root, _ = mjcf_tree(loaded, plain, draft)
    left = np.zeros_like(data.q)
    for part, dry in draft.left_out:
        left += torque_of(cause_named(part.cause), data, part)
        if dry:
            left[:, part.joint - 1] -= dry * data.smooth(data.directions[:, part.joint - 1])
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
        robot: name or model file; arms that are not shipped need the file.
        payload: known mass [kg] and centre of mass x, y, z in the flange frame [m] of a mounted
            body; None for the known payload of the diagnosis. A payload that was found is added.
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


def _friction(draft: ModelDraft, data: Data, arm: Arm) -> tuple[FrictionParameters, dict[str, str]]:
    """Return the friction and the source of each of its quantities."""

    def limited(which: Bools, text: str) -> None:
        for j in np.flatnonzero(which):
            said = text.format(j=j + 1)
            draft.not_in_mjcf.append(said)
            draft.not_in_tables.append(said)

    n, before = data.n, draft.values
    unknown = np.isnan(before["bristle_stiffness"])
    mean, half = draft.coulomb.mean(axis=1), np.diff(draft.coulomb, axis=1)[:, 0] / -2
    limited((mean < 0) | (before["viscous"].min(axis=1) < 0), NEGATIVE)
    mean = np.maximum(mean, LEAST_FRICTION)
    most = MOST_ASYMMETRY * mean
    limited(np.abs(half) > most * (1 + 1e-9), ASYMMETRIC)
    half = np.clip(half, -most, most)
    coulomb = np.maximum(np.stack([mean + half, mean - half], axis=1), LEAST_FRICTION)
    rise = before["stiction"] - draft.coulomb
    limited(rise.min(axis=1) < -LEAST_FRICTION, FALLING)
    stiction = coulomb + np.maximum(rise, 0.0)
    distance = data.friction.presliding_distance
    bristle = np.where(
        unknown, np.maximum(mean / distance, LEAST_BRISTLE), before["bristle_stiffness"]
    )
    ratio, own = coulomb / stiction, before["load_coefficient"]
    # ours scales stiction, which contains Coulomb friction; the cause scales Coulomb friction
    load = own + draft.load / ratio.mean(axis=1)
    limited(load < np.minimum(own, 0.0), LIGHTER)
    values = before | {
        "stiction": stiction,
        "coulomb_ratio": ratio,
        "viscous": np.maximum(before["viscous"], 0.0),
        "load_coefficient": np.maximum(load, np.minimum(own, 0.0)),
        "bristle_stiffness": np.maximum(bristle, 1e-3),
        "rotor_inertia": np.maximum(before["rotor_inertia"], 0.0),
    }

    def say(joint: int, text: str) -> None:
        if not unknown[joint] or "bristle" not in text:  # nothing was found that it bounds
            limited(np.arange(n) == joint, "joint {j}: " + text)

    friction = steady(FrictionParameters(**values), arm, data.arm, say=say)
    sources = dict.fromkeys(QUANTITIES, "stiction diagnose: nominal model and causes of [[cause]]")
    for name in ("bristle_damping_ratio", "joint_damping_ratio"):
        sources[name] = "assumed, or of the nominal model"
    if unknown.any():
        sources["bristle_stiffness"] = (
            "assumed where no presliding was found: Coulomb friction over a distance of "
            f"{float(distance.mean()):.2g} rad, softer where a step of 1 ms needs it"
        )
    return friction, sources


def _for_mjcf(friction: FrictionParameters, draft: ModelDraft) -> FrictionParameters:
    """Return the friction half-way through the logs at their mean load, as MJCF represents it."""
    level = draft.mean_load
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


def mjcf_tree(
    arm: Arm, friction: FrictionParameters, draft: ModelDraft | None = None
) -> tuple[ET.Element, ET.Element]:
    """Return plain MJCF of an arm that sticks, and its actuators.

    Gravity is compensated as far as the robot's own file does it.

    Args:
        arm: the arm with its payloads and gravity.
        friction: the part of the friction that MuJoCo can represent.
        draft: springs to the world, offsets and further cogging; None for none.

    Raises:
        StictionError: MuJoCo cannot represent the model.
    """
    text = export.plain_mjcf(build(arm, friction, timestep=TIMESTEP), friction_name="a diagnosis")
    root = ET.fromstring(text)
    for body in root.iter("body"):
        share = arm.stated.gravcomp.get(body.get("name", ""), 0.0)
        body.attrib.pop("gravcomp", None)
        body.attrib |= {"gravcomp": repr(share)} if share else {}
    actuators = root.find("actuator")
    assert actuators is not None
    if draft is None:
        return root, actuators
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    joints = {e.get("name"): e for e in root.iter("joint")}
    for name, (stiffness, rest), offset in zip(
        arm.joint_names, draft.pull, draft.values["offset"].tolist(), strict=True
    ):
        if stiffness > 0:
            joints[name].set("stiffness", repr(float(stiffness)))
            joints[name].set("springref", repr(float(np.degrees(rest) if degrees else rest)))
        if offset:
            general = {"name": f"{name}_offset", "joint": name, "gainprm": "0"}
            general |= {"biastype": "affine", "biasprm": f"{-offset!r} 0 0"}
            ET.SubElement(actuators, "general", general)
    for number, (j, *wave) in enumerate(draft.waves, start=1):
        name = arm.joint_names[j]
        # a motor without a command; in torque control it does not brake
        motor = {"name": f"{name}_wave{number}", "joint": name, "input": "ff"}
        motor |= {"motorconst": "1", "resistance": "1", "cogging": mjcf.numbers(wave)}
        ET.SubElement(actuators, "dcmotor", motor)
    return root, actuators


def mjcf_text(arm: Arm, root: ET.Element, comment: str, missing: Sequence[str]) -> str:
    """Return a tree as text with a comment, which has places for name, timestep and ``missing``.

    Raises:
        StictionError: MuJoCo does not read it.
    """
    listed = [f"     - {m}" for m in missing] or ["     - nothing"]
    said = comment.format(name=arm.name, timestep=TIMESTEP, missing="\n".join(listed))
    return export.mjcf_text(root, said, f"{arm.name}: the extended model cannot be built")
