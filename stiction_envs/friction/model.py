"""MuJoCo model of an arm that sticks, from the rigid arm and its friction parameters.

Per joint i the model has, all native MuJoCo:

* hinge ``<joint>`` – the motor side: armature = rotor inertia, damping = viscous friction;
* for an elastic joint a second hinge ``<joint>_spring`` on the same axis, with stiffness and
  damping: link angle = sum of both;
* actuator ``<joint>_torque`` – ``dcmotor`` with ``input="ff"``: its control is joint torque [N·m],
  and it carries the LuGre bristle and the position ripple (as MuJoCo's cogging);
* actuator ``<joint>_servo`` – a position servo on the motor side with gains of zero, which the
  plant raises where an experiment holds the joint.

Gravity is compensated by MuJoCo's ``gravcomp``, as the arm's own controller does it.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError
from stiction_envs.friction.from_file import own_friction
from stiction_envs.friction.inertia import link_inertia, mass_and_gravity
from stiction_envs.friction.parameters import (
    CONTROL_DT,
    FrictionParameters,
    bristle_damping,
    check_stability,
)
from stiction_envs.friction.servos import PositionServos
from stiction_envs.robots import Arm
from stiction_envs.robots.mjcf import numbers, parents

# columns of actuator_biasprm and actuator_dynprm that hold the rest of the law (sources.md 3.5)
RIPPLE, BRISTLE_DAMPING = 0, 6
NO_GRAVITY_NM = 0.02
"""Largest gravity torque under which a joint counts as one that sees none [N·m]; assumed."""
_POSES = 256  # Random poses in which gravity is looked at [-]; assumed


@dataclass(frozen=True, kw_only=True, repr=False)
class StickingModel:
    """A compiled arm that sticks, and the indices of its joints."""

    arm: Arm
    parameters: FrictionParameters  # Friction of one arm, fields (n,) or (n, 2)
    model: mujoco.MjModel
    motor: Index  # (n,) dof (and qpos) of each joint's motor side
    spring: Index  # (n,) dof of each joint's spring, −1 where the joint is rigid
    torque_actuator: Index  # (n,) actuator whose control is joint torque
    servo_actuator: Index  # (n,) actuator that holds the joint
    friction_inertia: Array  # (n,) rotor inertia, plus the link's if rigid [kg·m²]
    bearing: Bools  # (n,) joints whose load is the bearing's tilting moment (`load_sensor`)
    timestep: float  # Physics step [s]
    servos: PositionServos | None = None  # Position servos of the friction TOML

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.motor)

    def __repr__(self) -> str:
        return f"<StickingModel of {self.arm.name}, {self.n} joints>"

    def link_position(self, qpos: Array) -> Array:
        """Return (..., n) link angles [rad] from (..., nq) MuJoCo positions."""
        q, elastic = qpos[..., self.motor], self.spring >= 0
        q[..., elastic] += qpos[..., self.spring[elastic]]
        return q

    def bristle_damping_of(self, parameters: FrictionParameters) -> Array:
        """Return (..., n) σ1 [N·m·s/rad] of other parameters; raise if a bristle would chatter."""
        inertia = self.friction_inertia + (parameters.rotor_inertia - self.parameters.rotor_inertia)
        return _stable_damping(parameters, inertia, self.timestep)


def _stable_damping(parameters: FrictionParameters, inertia: Array, timestep: float) -> Array:
    ratio = parameters.bristle_damping_ratio
    damping = bristle_damping(parameters.bristle_stiffness, ratio, inertia, timestep)
    check_stability(damping, inertia, timestep)
    return damping


def build(
    arm: Arm, parameters: FrictionParameters | None = None, *, timestep: float = CONTROL_DT
) -> StickingModel:
    """Build the model of an arm that sticks.

    Args:
        arm: the rigid arm.
        parameters: friction of one arm; None for the arm's friction.
        timestep: physics step, at most `CONTROL_DT`.

    Raises:
        StictionError: step too long, parameters for another number of joints, or a bristle
            that would chatter at this step (sources.md 3.5).
    """
    if not 0 < timestep <= CONTROL_DT:
        raise StictionError(f"timestep {timestep} s: expected 0 < timestep <= {CONTROL_DT:g}")
    if parameters is None:
        parameters = own_friction(arm)
    if parameters.n != arm.n:
        raise StictionError(f"friction of {parameters.n} joints, but {arm.name} has {arm.n}")
    elastic = parameters.elastic
    inertia = parameters.rotor_inertia + np.where(
        elastic, 0.0, link_inertia(arm, arm.rest[None])[0]
    )
    damping = _stable_damping(parameters, inertia, timestep)
    root = sticking_tree(arm, parameters, damping, timestep)
    actuators = root.find("actuator")
    assert actuators is not None
    for name, limit in zip(arm.joint_names, arm.limits.torque, strict=True):
        servo = {"name": f"{name}_servo", "joint": name, "kp": "0"}
        ET.SubElement(actuators, "position", servo, forcerange=numbers([-limit, limit]))
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))

    def dof(name: str) -> int:
        return int(model.joint(name).dofadr[0])

    pairs = zip(arm.joint_names, elastic, strict=True)
    low, high = arm.limits.position.T
    poses = np.random.default_rng(0).uniform(low, high, size=(_POSES, arm.n))
    gravity = np.abs(mass_and_gravity(arm, poses)[1]).max(axis=0)
    return StickingModel(
        arm=arm,
        parameters=parameters,
        model=model,
        motor=np.array([dof(j) for j in arm.joint_names]),
        spring=np.array([dof(f"{j}_spring") if e else -1 for j, e in pairs]),
        torque_actuator=np.array([model.actuator(f"{j}_torque").id for j in arm.joint_names]),
        servo_actuator=np.array([model.actuator(f"{j}_servo").id for j in arm.joint_names]),
        friction_inertia=inertia,
        bearing=gravity < NO_GRAVITY_NM,
        timestep=timestep,
    )


def sticking_tree(
    arm: Arm, parameters: FrictionParameters, damping: Array, timestep: float
) -> ET.Element:
    """Return MJCF of an arm that sticks, with all digits; the control of each joint is its torque.

    ``damping`` (n,) is σ1 of the bristles [N·m·s/rad]; parameters are taken at rest, without load.
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
