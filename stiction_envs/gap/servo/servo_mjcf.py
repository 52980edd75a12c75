"""A diagnosed arm under position servos as plain MJCF and as ``model.toml``."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.friction.parameters import QUANTITIES
from stiction_envs.gap.extended_model import Extension, mjcf_text, mjcf_tree
from stiction_envs.gap.model_file import Nominal, changed_arm
from stiction_envs.gap.servo.causes import LAG, ServoLag, servo_cause
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.servo_parameters import FAR, HIGH, INDEX, LOW, NAMES, PARAMETERS
from stiction_envs.gap.servo.whole_arm import friction_of, reaching
from stiction_envs.reporting.toml import toml_text
from stiction_envs.robots import Arm
from stiction_envs.robots.arm_toml import read_toml

_COMMENT = """ {name} under position servos as its logs show it, by stiction diagnose. SI units.
     Controls JOINT_servo are commanded angles [rad]; JOINT_torque are further torques [N m], zero
     on the robot. Friction is a LuGre bristle in each dcmotor, so that joints stop short and stay;
     damping is joint damping. Gravity acts. Keep integrator Euler and a timestep of at most
     {timestep:g} s. Contacts are off. What was found and MuJoCo cannot express:
{missing} """


def servo_extension(d: ServoDiagnosis, arm: Arm, before: Nominal) -> Extension:
    """Return the arm with what a diagnosis found, and what earlier ones found at its flange."""
    parts = before.parts
    if d.payload is not None:
        parts = (*parts, d.payload.part(1 + max((p.level for p in parts), default=0)))
    arm = reaching(changed_arm(arm, parts), d.logs)
    xml, missing = servo_mjcf(arm, d.parameters, d.load)
    friction = friction_of(arm, d.parameters, d.load)
    changed = [
        name
        for c in d.causes
        for name in (LAG if c.name == ServoLag.name else servo_cause(c.name).servo.sizes)
    ]
    sources = dict.fromkeys(QUANTITIES, "assumed: no servo log shows it")
    sources |= {
        q: "stiction diagnose: servo logs" for name in changed for q in PARAMETERS[name].friction
    }
    return Extension(
        xml=xml,
        friction=friction,
        sources=sources,
        nominal=Nominal(
            friction=friction, parts=parts, robot=arm.name, payload=arm.payload, tilt=arm.tilt
        ),
        missing=missing,
        friction_missing=(),
        left_out=np.zeros((0, arm.n)),
        servo=servo_toml(d.parameters),
    )


def servo_mjcf(arm: Arm, parameters: Array, load: Array) -> tuple[str, tuple[str, ...]]:
    """Return plain MJCF of the rigid arm under servos of (n, P) parameters, and what is missing.

    Load-dependent friction is held at ``load`` (n,), the usual size of gravity [N·m].

    Raises:
        StictionError: MuJoCo cannot represent the model.
    """
    missing = tuple(
        f"joint {j}: " + p.not_in_mjcf.format(x=x)
        for p, values in zip(PARAMETERS.values(), parameters.T.tolist(), strict=True)
        for j, x in enumerate(values, start=1)
        if p.not_in_mjcf and x != p.absent and x < FAR
    )
    friction = friction_of(arm, parameters, load)
    level = friction.stiction + (friction.load_coefficient * load)[:, None]
    friction = friction.replace(stiction=level, load_coefficient=np.zeros(arm.n))
    root, actuators = mjcf_tree(arm, friction)
    for j, name in enumerate(arm.joint_names):
        servo = ET.SubElement(
            actuators,
            "position",
            name=f"{name}_servo",
            joint=name,
            kp=repr(float(parameters[j, INDEX["stiffness"]])),
        )
        limit = float(parameters[j, INDEX["torque_limit"]])
        if limit < FAR:
            servo.set("forcerange", f"{-limit!r} {limit!r}")
    return mjcf_text(arm, root, _COMMENT, missing), missing


def servo_toml(parameters: Array) -> str:
    """Return the TOML table ``[servo]``; floats read back exactly."""
    table = {name: parameters[:, INDEX[name]].tolist() for name in NAMES}
    what = "Servos and friction of joints 1 to n: for --nominal of stiction diagnose."
    return "\n" + toml_text({"servo": table}, comments={"servo": what})


def read_servo(path: Path, n: int) -> Array:
    """Return (n, P) parameters from the table ``[servo]`` of a ``model.toml``.

    Raises:
        StictionError: unreadable, without that table, or with numbers that cannot be.
    """
    table = read_toml(path).get("servo", {})
    try:
        each = [
            checked_array(table[name], f"nominal {path}: [servo] {name}", (n,)) for name in NAMES
        ]
    except (KeyError, TypeError):
        raise StictionError(
            f"nominal {path}: expected [servo] as a diagnosis of servo logs writes it into "
            f"model.toml, with {', '.join(NAMES)}"
        ) from None
    out = np.stack(each, axis=1)
    wrong = ~((out >= LOW) & (out <= HIGH))
    if wrong.any():
        j, k = np.argwhere(wrong)[0]
        raise StictionError(
            f"nominal {path}: [servo] {NAMES[k]} of joint {j + 1} is {out[j, k]:g}: expected "
            f"{LOW[k]:g} to {HIGH[k]:g}"
        )
    return out
