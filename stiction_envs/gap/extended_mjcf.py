"""Plain MJCF of a diagnosed arm: its bodies and gravity, springs and offsets, native friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.export import plain_mjcf
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.robots import Arm, mjcf

Array = NDArray[np.float64]
TIMESTEP = 1e-3
"""Time step of the model [s]; assumed."""


def mjcf_tree(
    arm: Arm,
    friction: FrictionParameters,
    *,
    pull: Array | None = None,
    offset: Array | None = None,
    waves: Sequence[tuple[int, float, float, float]] = (),
) -> tuple[ET.Element, ET.Element]:
    """Return plain MJCF of an arm that sticks, and its actuators.

    Gravity is compensated as far as the robot's own file does it.

    Args:
        arm: the arm with its payloads and gravity.
        friction: the part of the friction that MuJoCo can represent.
        pull: (n, 2) stiffness [N·m/rad] and rest angle [rad] of a spring to the world.
        offset: (n,) constant torque that a motor must overcome [N·m].
        waves: joint (from 0), amplitude [N·m], periods per turn and phase [rad] of further cogging.

    Raises:
        StictionError: MuJoCo cannot represent the model.
    """
    text = plain_mjcf(build(arm, friction, timestep=TIMESTEP), friction_name="a diagnosis")
    root = ET.fromstring(text)
    for body in root.iter("body"):
        share = arm.stated.gravcomp.get(body.get("name", ""), 0.0)
        body.attrib.pop("gravcomp", None)
        body.attrib |= {"gravcomp": repr(share)} if share else {}
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    joints = {e.get("name"): e for e in root.iter("joint")}
    actuators = root.find("actuator")
    assert actuators is not None
    pull = np.zeros((arm.n, 2)) if pull is None else pull
    offset = np.zeros(arm.n) if offset is None else offset
    for j, name in enumerate(arm.joint_names):
        stiffness, rest = pull[j]
        if stiffness > 0:
            joints[name].set("stiffness", repr(float(stiffness)))
            joints[name].set("springref", repr(float(np.degrees(rest) if degrees else rest)))
        if offset[j]:
            ET.SubElement(
                actuators,
                "general",
                name=f"{name}_offset",
                joint=name,
                gainprm="0",
                biastype="affine",
                biasprm=f"{-float(offset[j])!r} 0 0",
            )
    for number, (j, *wave) in enumerate(waves, start=1):
        # a motor without a command; in torque control it does not brake
        ET.SubElement(
            actuators,
            "dcmotor",
            name=f"{arm.joint_names[j]}_wave{number}",
            joint=arm.joint_names[j],
            input="ff",
            motorconst="1",
            resistance="1",
            cogging=mjcf.numbers(wave),
        )
    return root, actuators


def mjcf_text(arm: Arm, root: ET.Element, comment: str, missing: Sequence[str]) -> str:
    """Return a tree as text that MuJoCo reads.

    Args:
        arm: the arm.
        root: from `mjcf_tree`.
        comment: the comment at the top, with places for name, timestep and missing.
        missing: effects that MuJoCo cannot represent.

    Raises:
        StictionError: MuJoCo does not read it.
    """
    listed = [f"     - {m}" for m in missing] or ["     - nothing"]
    said = comment.format(name=arm.name, timestep=TIMESTEP, missing="\n".join(listed))
    ET.indent(root)
    out = f"<!--{said.replace('--', '- -')}-->\n{ET.tostring(root, encoding='unicode')}\n"
    try:
        mujoco.MjModel.from_xml_string(out)
    except ValueError as error:
        raise StictionError(f"{arm.name}: the extended model cannot be built: {error}") from None
    return out
