"""A sticking model as MJCF text with all digits (``MjSpec.to_xml`` writes six)."""

from __future__ import annotations

import textwrap
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel, sticking_tree
from stiction_envs.reporting.templates import render
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

TEMPLATE = Path(__file__).parent / "templates" / "model.txt.j2"
INDENT = " " * 5


def plain_mjcf(
    sticking: StickingModel, *, friction_name: str, kind: Kind = "dcmotor", motor: MotorInput = "ff"
) -> str:
    """Return MJCF from which stock MuJoCo compiles the same model.

    Args:
        sticking: the model.
        friction_name: name of the friction in the comment at the top.
        kind: element that carries dry friction; ``frictionloss`` has the breakaway torque.
        motor: input of the ``dcmotor``.

    Raises:
        StictionError: MuJoCo does not read the text.
    """
    arm, model = sticking.arm, sticking.model
    own = sticking.parameters
    root = sticking_tree(arm, own, sticking.bristle_damping_of(own), sticking.timestep)
    joints = {j.get("name"): j for j in root.iter("joint")}
    motors = list(root.iter("dcmotor"))
    for name, limit, element in zip(arm.joint_names, arm.limits.torque, motors, strict=True):
        if kind == "frictionloss":
            element.tag, element.attrib = "motor", {"name": f"{name}_torque", "joint": name}
            actuator = model.actuator(f"{name}_torque").id
            level = repr(float(model.actuator_biasprm[actuator, STICTION]))
            joints[name].set("frictionloss", level)
            for key, value in HARDEST.items():
                joints[name].set(key, value.format(2 * sticking.timestep))
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

    bias = model.actuator_biasprm[sticking.torque_actuator]
    bristle = model.actuator_dynprm[sticking.torque_actuator, BRISTLE_STIFFNESS]
    words = render(
        TEMPLATE,
        name=arm.name,
        friction=friction_name,
        kind=kind,
        motor=motor,
        timestep=f"{sticking.timestep:g}",
        presliding=f"{float((bias[:, STICTION] / bristle).max()):.2g}",
        stribeck=f"{float((bias[:, STICTION] / bias[:, COULOMB]).max() - 1):.0%}",
        offsets=bool(own.offset.any() or own.gravity_error.any()),
    )
    paragraphs = words.replace("--", "- -").strip().split("\n\n")
    wrap = textwrap.TextWrapper(
        100, initial_indent=INDENT, subsequent_indent=INDENT, break_on_hyphens=False
    )
    comment = "\n".join(wrap.fill(p) for p in paragraphs)
    ET.indent(root)
    text = f"<!-- {comment.strip()} -->\n{ET.tostring(root, encoding='unicode')}\n"
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise StictionError(f"{arm.name}: cannot be exported: {error}") from None
    return text
