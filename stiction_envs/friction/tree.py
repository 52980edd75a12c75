"""MJCF of an arm whose joints have rotors, gears and LuGre friction, with all digits."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.robots import Arm
from stiction_envs.robots.mjcf import numbers, parents


def sticking_tree(
    arm: Arm, parameters: FrictionParameters, damping: Array, timestep: float
) -> ET.Element:
    """Return MJCF of an arm that sticks; the control of each joint is its torque.

    Args:
        arm: the rigid arm.
        parameters: friction of one arm, at rest and without load.
        damping: (n,) of the bristles, σ1 [N·m·s/rad].
        timestep: [s].
    """
    p, root = parameters, ET.fromstring(arm.xml)
    option = root.find("option")
    if option is None:
        option = ET.Element("option")
        root.insert(0, option)
    # implicit integrators add a phantom inertia h·σ1 to a sliding LuGre joint (sources.md 3.5)
    option.attrib |= {"timestep": repr(timestep), "integrator": "Euler"}
    flag = option.find("flag")
    flag = ET.SubElement(option, "flag") if flag is None else flag
    flag.set("contact", "disable")
    # a default for actuators would change ours
    for default in root.iter("default"):
        for kind in ("general", "motor", "position", "velocity", "dcmotor"):
            for element in default.findall(kind):
                default.remove(element)
    for body in root.iter("body"):
        body.set("gravcomp", "1")
    up, joints = parents(root), {j.get("name"): j for j in root.iter("joint")}
    actuators = ET.SubElement(root, "actuator")
    stiction = p.stiction_at(p.load_low).mean(axis=1)
    for i, name in enumerate(arm.joint_names):
        joint, rotor, stiffness = joints[name], p.rotor_inertia[i], p.joint_stiffness[i]
        joint.attrib |= {"armature": numbers([rotor]), "damping": numbers([p.viscous[i].mean()])}
        if np.isfinite(stiffness):
            ratio = p.joint_damping_ratio[i]
            same = ("class", "pos", "axis")
            spring = {k: v for k, v in joint.attrib.items() if k in same}
            spring |= {"name": f"{name}_spring", "type": "hinge", "limited": "false"}
            spring |= {"stiffness": numbers([stiffness]), "armature": "0"}
            spring["damping"] = numbers([2 * ratio * np.sqrt(stiffness * rotor)])
            home = up[joint]
            home.insert(list(home).index(joint) + 1, ET.Element("joint", spring))
        bristle = (p.bristle_stiffness[i], damping[i], stiction[i] * p.coulomb_ratio[i].mean())
        motor = ET.SubElement(
            actuators,
            "dcmotor",
            name=f"{name}_torque",
            joint=name,
            input="ff",
            motorconst="1",
            resistance="1",
            lugre=numbers([*bristle, stiction[i], p.stribeck_velocity[i].mean()]),
        )
        # also without an amplitude: the model must be the same number by number
        cogging = [p.ripple_amplitude[i], p.ripple_periods[i], p.ripple_phase[i]]
        if any(cogging):
            motor.set("cogging", numbers(cogging))
    return root
