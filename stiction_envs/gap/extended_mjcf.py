"""Plain MJCF of a diagnosed arm: its bodies and gravity, springs and offsets, native friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.friction.plain_mjcf import plain_mjcf
from stiction_envs.robots import Arm, mjcf

Array = NDArray[np.float64]
TIMESTEP = 1e-3
"""Time step of the model [s]; assumed."""


_COMMENT = """ {name} as its logs show it, written by stiction diagnose. SI units.
     Controls are joint torques [N m] as in the logs: they carry gravity themselves, nothing is
     compensated here. Friction is a LuGre bristle in each dcmotor, rotor inertia is armature,
     viscous friction damping. Keep integrator Euler and a timestep of at most {timestep:g} s.
     Contacts are off. What was found and MuJoCo cannot express:
{missing} """


def write_mjcf(
    arm: Arm,
    friction: FrictionParameters,
    *,
    pull: Array,
    offset: Array,
    waves: Sequence[tuple[int, float, float, float]] = (),
    missing: Sequence[str],
) -> str:
    """Return plain MJCF of an arm that sticks.

    Args:
        arm: the arm with its payloads and gravity.
        friction: the part of the friction that MuJoCo can represent.
        pull: (n, 2) stiffness [N·m/rad] and rest angle [rad] of a spring to the world.
        offset: (n,) constant torque that a motor must overcome [N·m].
        waves: joint (from 0), amplitude [N·m], periods per turn and phase [rad] of further cogging.
        missing: effects that MuJoCo cannot represent, for the comment.

    Raises:
        StictionError: MuJoCo cannot represent the model.
    """
    text = plain_mjcf(build(arm, friction, timestep=TIMESTEP), friction_name="a diagnosis")
    root = ET.fromstring(text)
    for body in root.iter("body"):
        body.attrib.pop("gravcomp", None)
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    joints = {e.get("name"): e for e in root.iter("joint")}
    actuators = root.find("actuator")
    assert actuators is not None
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
    listed = [f"     - {m}" for m in missing] or ["     - nothing"]
    comment = _COMMENT.format(
        name=arm.name, timestep=TIMESTEP, missing="\n".join(listed).replace("--", "- -")
    )
    ET.indent(root)
    out = f"<!--{comment}-->\n{ET.tostring(root, encoding='unicode')}\n"
    try:
        mujoco.MjModel.from_xml_string(out)
    except ValueError as error:
        raise StictionError(f"{arm.name}: the extended model cannot be built: {error}") from None
    return out
