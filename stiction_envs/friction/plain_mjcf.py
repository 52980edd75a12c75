"""A sticking model as MJCF text with all digits (``MjSpec.to_xml`` writes six)."""

from __future__ import annotations

import textwrap
import xml.etree.ElementTree as ET
from typing import Literal

import mujoco
import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    RIPPLE,
    STICTION,
    STRIBECK,
    StickingModel,
)
from stiction_envs.robots.mjcf import numbers, parents

Kind = Literal["dcmotor", "frictionloss"]
"""How a model carries dry friction: a LuGre bristle, or MuJoCo's soft constraint."""
MotorInput = Literal["ff", "voltage"]
"""Input of a ``dcmotor`` whose control is joint torque. Newton takes ``voltage`` only."""
WINDING = "1e-06"
"""Torque constant [N·m/A] and resistance [Ω] of a motor whose voltage is its torque: the ratio is
1, and what the back-EMF damps, their product over it, is 1e-6 N·m·s/rad (assumed to be nothing)."""
HARDEST = {"solreffriction": "{:g} 1", "solimpfriction": "0.9999 0.9999 0.001"}
"""``frictionloss`` that creeps least without `NOSLIP`: MuJoCo's largest impedance, and the shortest
time constant that a step allows, twice its length (benchmarks/engines/engines.md)."""
NOSLIP = 5
"""Iterations of MuJoCo's noslip solver, which then leaves a creep under 1e-12 rad/s (the same)."""

_COMMENT = (
    "{name} with joints that stick, written by stiction export. SI units.",
    "Friction: {friction}. {native}, rotor inertia as armature, viscous friction as damping, "
    "elastic gears as a second hinge JOINT_spring on the same axis (link angle = JOINT + "
    "JOINT_spring). Controls are joint torques [N m], within the limits of the arm. Gravity is "
    "compensated by gravcomp, as by the arm's own controller.",
    "{keep} Contacts are off, as in our experiments; remove the flag to enable them. Keyframe "
    '"home" is the rest pose.',
    "{lost}",
    "Plain MJCF cannot express, and this file leaves out: torque offsets and gravity-compensation "
    "error{offsets}, friction that depends on direction (here: the mean), on load (here: the level "
    "of the unloaded joint) or on warm-up, a controller slower than the simulation, limits of "
    "torque rate and low-pass.",
)
INDENT = " " * 5
_EULER = (
    "Keep integrator Euler and a timestep of at most {timestep:g} s: implicit integrators and "
    "longer steps change a LuGre joint."
)
_WORDS: dict[str, tuple[str, str, str]] = {
    "ff": ("It is native MuJoCo: a LuGre bristle in each dcmotor", _EULER, ""),
    "voltage": (
        "It is native MuJoCo: a LuGre bristle in each dcmotor",
        f"{_EULER} Newton does not read the timestep: step with it.",
        "Each motor's torque constant equals its resistance, so that a volt is a newton metre; "
        "both are small, as is the damping by the back-EMF (1e-6 N m s/rad).",
    ),
    "frictionloss": (
        "It is MuJoCo's frictionloss, for engines without a LuGre bristle",
        "solreffriction is twice the timestep of {timestep:g} s: change both together.",
        "A model with dcmotor friction has what this one loses: presliding (joints rest rigidly, "
        "without up to {presliding:.2g} rad of give, its stiffness and its damping); the Stribeck "
        "curve (sliding takes the breakaway torque, which is up to {stribeck:.0%} too much); "
        "breakaway that depends on the rate of torque; ripple over the angle. frictionloss is a "
        "soft constraint and creeps under any load. noslip_iterations stops that in engines that "
        "have it (MuJoCo, MuJoCo Warp); for the others solreffriction and solimpfriction are those "
        "that creep least. stiction conformance measures what is left.",
    ),
}
"""By motor input or kind: what the comment says the friction is, what to keep, what is lost."""


def plain_mjcf(
    sticking: StickingModel,
    *,
    friction_name: str,
    kind: Kind = "dcmotor",
    motor: MotorInput = "ff",
) -> str:
    """Return MJCF from which stock MuJoCo compiles the same model.

    Args:
        sticking: the model.
        friction_name: name of the friction in the comment at the top.
        kind: what carries the dry friction; ``frictionloss`` is of its breakaway torque.
        motor: input of the ``dcmotor``.

    Raises:
        StictionError: the model compiled from the text differs.
    """
    arm, model = sticking.arm, sticking.model
    root = ET.fromstring(arm.xml)
    _options(root, sticking.timestep)
    for body in root.iter("body"):
        body.set("gravcomp", "1")
    up = parents(root)
    joints = {j.get("name"): j for j in root.iter("joint")}
    for name in arm.joint_names:
        element = joints[name]
        _motor_side(element, model)
        if kind == "frictionloss":
            _frictionloss(element, sticking)
        if f"{name}_spring" in {model.joint(j).name for j in range(model.njnt)}:
            home = up[element]
            home.insert(list(home).index(element) + 1, _spring(f"{name}_spring", model))
    actuators = ET.SubElement(root, "actuator")
    for name, limit in zip(arm.joint_names, arm.limits.torque, strict=True):
        element = (
            _dcmotor(name, model, motor)
            if kind == "dcmotor"
            else ET.Element("motor", name=f"{name}_torque", joint=name)
        )
        if np.isfinite(limit):
            element.set("ctrlrange", numbers([-float(limit), float(limit)]))
        actuators.append(element)
    if kind == "frictionloss":
        option = root.find("option")
        assert option is not None
        option.set("noslip_iterations", str(NOSLIP))
    rest = np.zeros(model.nq)
    rest[sticking.motor] = arm.rest
    keys = ET.SubElement(root, "keyframe")
    ET.SubElement(keys, "key", name="home", qpos=numbers(rest))

    arm.carry_into(root)

    offsets = sticking.parameters.offset, sticking.parameters.gravity_error
    bias = model.actuator_biasprm[sticking.torque_actuator]
    bristle = model.actuator_dynprm[sticking.torque_actuator, BRISTLE_STIFFNESS]
    native, keep, lost = (
        words.format(
            timestep=sticking.timestep,
            presliding=float((bias[:, STICTION] / bristle).max()),
            stribeck=float((bias[:, STICTION] / bias[:, COULOMB]).max() - 1),
        )
        for words in _WORDS[motor if kind == "dcmotor" else kind]
    )
    paragraphs = (
        words.format(
            name=arm.name,
            friction=friction_name,
            native=native,
            keep=keep,
            lost=lost,
            offsets=" (this arm has some)" if any(o.any() for o in offsets) else "",
        ).replace("--", "- -")
        for words in _COMMENT
    )
    wrap = textwrap.TextWrapper(
        100, initial_indent=INDENT, subsequent_indent=INDENT, break_on_hyphens=False
    )
    comment = "\n".join(wrap.fill(p) for p in paragraphs if p)
    ET.indent(root)
    text = f"<!-- {comment.strip()} -->\n{ET.tostring(root, encoding='unicode')}\n"
    _check(text, sticking, kind, motor)
    return text


def mjcf_for(sticking: StickingModel, motor: MotorInput | None, friction_name: str = "") -> str:
    """Return `plain_mjcf` for an engine: with ``dcmotor`` friction if it takes one.

    Args:
        sticking: the model.
        motor: input of the ``dcmotor`` that the engine takes, None for none.
        friction_name: as in `plain_mjcf`; the arm's by default.
    """
    name = friction_name or sticking.arm.name
    if motor is None:
        return plain_mjcf(sticking, friction_name=name, kind="frictionloss")
    return plain_mjcf(sticking, friction_name=name, motor=motor)


def _options(root: ET.Element, timestep: float) -> None:
    option = root.find("option")
    if option is None:
        option = ET.Element("option")
        root.insert(0, option)
    option.set("timestep", repr(timestep))
    option.set("integrator", "Euler")
    flag = option.find("flag")
    if flag is None:
        flag = ET.SubElement(option, "flag")
    flag.set("contact", "disable")
    # a default for actuators would change ours
    for default in root.iter("default"):
        for kind in ("general", "motor", "position", "velocity", "dcmotor"):
            for element in default.findall(kind):
                default.remove(element)


def _motor_side(element: ET.Element, model: mujoco.MjModel) -> None:
    joint = model.joint(element.get("name"))
    element.attrib.pop("frictionloss", None)
    element.set("armature", repr(float(joint.armature[0])))
    element.set("damping", repr(float(joint.damping[0])))


def _frictionloss(element: ET.Element, sticking: StickingModel) -> None:
    model = sticking.model
    actuator = model.actuator(f"{element.get('name')}_torque").id
    element.set("frictionloss", repr(float(model.actuator_biasprm[actuator, STICTION])))
    for key, value in HARDEST.items():
        element.set(key, value.format(2 * sticking.timestep))


def _spring(name: str, model: mujoco.MjModel) -> ET.Element:
    joint = model.joint(name)
    return ET.Element(
        "joint",
        name=name,
        type="hinge",
        limited="false",
        pos=numbers(joint.pos),
        axis=numbers(joint.axis),
        stiffness=repr(float(np.ravel(joint.stiffness)[0])),
        damping=repr(float(joint.damping[0])),
        armature="0",
        frictionloss="0",
    )


def _dcmotor(name: str, model: mujoco.MjModel, motor: MotorInput) -> ET.Element:
    actuator = model.actuator(f"{name}_torque").id
    bias, dyn = model.actuator_biasprm[actuator], model.actuator_dynprm[actuator]
    element = ET.Element(
        "dcmotor",
        name=f"{name}_torque",
        joint=name,
        input=motor,
        motorconst="1" if motor == "ff" else WINDING,
        resistance="1" if motor == "ff" else WINDING,
        lugre=numbers(
            [
                dyn[BRISTLE_STIFFNESS],
                dyn[BRISTLE_DAMPING],
                bias[COULOMB],
                bias[STICTION],
                bias[STRIBECK],
            ]
        ),
    )
    # also without an amplitude: the model must be the same number by number
    if bias[RIPPLE : RIPPLE + 3].any():
        element.set("cogging", numbers(bias[RIPPLE : RIPPLE + 3]))
    return element


def _check(text: str, sticking: StickingModel, kind: Kind, motor: MotorInput) -> None:
    """Raise if stock MuJoCo does not read the text as the same model, to 1e-9 (assumed)."""
    try:
        again = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise StictionError(f"{sticking.arm.name}: cannot be exported: {error}") from None
    other = {"dof_frictionloss"} if kind == "frictionloss" else set()
    if kind == "frictionloss" or motor != "ff":
        other |= {"actuator_gainprm", "actuator_biasprm", "actuator_dynprm"}
    found = {k: v for k, v in differences(again, sticking).items() if k not in other}
    worst = {k: v for k, v in found.items() if not v <= 1e-9}
    if worst:
        name, value = max(worst.items(), key=lambda item: item[1])
        raise StictionError(f"{sticking.arm.name}: cannot be exported: {name} off by {value:.1e}")


def differences(again: mujoco.MjModel, sticking: StickingModel) -> dict[str, float]:
    """Return the largest relative difference of every physical field.

    Numbers under a thousandth (assumed) of their field's largest are compared with that thousandth.

    Args:
        again: the model read back; it has the torque actuators only.
        sticking: what it was made of.
    """
    model, act = sticking.model, sticking.torque_actuator
    fields = (
        *("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat"),
        *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness"),
        *("dof_armature", "dof_damping", "dof_frictionloss", "qpos0", "qpos_spring"),
    )
    pairs = {k: (getattr(again, k), getattr(model, k)) for k in fields}
    for k in ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "actuator_gear"):
        pairs[k] = (getattr(again, k), getattr(model, k)[act])
    pairs["body_gravcomp"] = (again.body_gravcomp[1:], model.body_gravcomp[1:])  # not the world's
    pairs["timestep"] = (np.array([again.opt.timestep]), np.array([model.opt.timestep]))
    pairs["gravity"] = (again.opt.gravity, model.opt.gravity)
    out = {}
    for k, (new, old) in pairs.items():
        if new.shape != old.shape:
            out[k] = np.inf
            continue
        scale = np.maximum(np.abs(old), 1e-3 * np.abs(old).max(initial=0.0))
        off = np.abs(new - old)
        out[k] = float((off[off > 0] / np.maximum(scale, 1e-12)[off > 0]).max(initial=0.0))
    return out
