"""A sticking model as MJCF text with all digits (``MjSpec.to_xml`` writes six)."""

from __future__ import annotations

import textwrap
import xml.etree.ElementTree as ET
from typing import Literal

import mujoco
import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.tree import sticking_tree
from stiction_envs.robots.mjcf import numbers
from stiction_envs.robots.stated import BRISTLE_STIFFNESS, COULOMB, STICTION

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
        StictionError: MuJoCo does not read the text.
    """
    arm, model = sticking.arm, sticking.model
    own = sticking.parameters
    root = sticking_tree(arm, own, sticking.bristle_damping_of(own), sticking.timestep)
    joints = {j.get("name"): j for j in root.iter("joint")}
    motors = [x for x in root.iter("dcmotor")]
    for name, limit, element in zip(arm.joint_names, arm.limits.torque, motors, strict=True):
        if kind == "frictionloss":
            element.tag, element.attrib = "motor", {"name": f"{name}_torque", "joint": name}
            _frictionloss(joints[name], sticking)
        elif motor != "ff":
            element.attrib |= {"input": motor, "motorconst": WINDING, "resistance": WINDING}
        if np.isfinite(limit):
            element.set("ctrlrange", numbers([-float(limit), float(limit)]))
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
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise StictionError(f"{arm.name}: cannot be exported: {error}") from None
    return text


def _frictionloss(element: ET.Element, sticking: StickingModel) -> None:
    model = sticking.model
    actuator = model.actuator(f"{element.get('name')}_torque").id
    element.set("frictionloss", repr(float(model.actuator_biasprm[actuator, STICTION])))
    for key, value in HARDEST.items():
        element.set(key, value.format(2 * sticking.timestep))
