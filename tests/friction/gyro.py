"""Two small arms of which everything is known, and friction for them.

`gyro`: two hinges with all centres of mass on the axes and spherical inertia, so that
M = diag(J_A, J_B), C = 0 and g = 0 in every pose. `pendulum`: the second link's mass hangs
`ARM` aside, so joint b carries gravity and joint a, vertical, carries its moment.
"""

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.hidden.friction_law import LuGre
from stiction_envs.robots import Arm, load_arm

J_A, J_B = 0.15, 0.05
MASS, ARM = 2.0, 0.5


@cache
def gyro(aside: float = 0.0) -> Arm:
    text = f"""
<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <body name="one"><joint name="a" axis="0 0 1" range="-1000 1000"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{J_A - J_B} {J_A - J_B} {J_A - J_B}"/>
    <body name="two"><joint name="b" axis="1 0 0" range="-1000 1000"/>
      <inertial pos="0 0 {aside}" mass="{MASS}" diaginertia="{J_B} {J_B} {J_B}"/>
    </body></body></body></worldbody></mujoco>"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "small.xml"
        path.write_text(text)
        return load_arm(path)


def pendulum() -> Arm:
    return gyro(ARM)


def friction(**changes: Any) -> FrictionParameters:
    """Friction of two joints, without ripple, load or bias; scalars and pairs are spread out."""
    values: dict[str, Any] = {
        "stiction": 0.6,
        "coulomb_ratio": 0.8,
        "stribeck_velocity": 0.01,
        "viscous": 0.0,
        "bristle_stiffness": 1000.0,
        "rotor_inertia": 0.05,
    } | changes
    out = {}
    for name, quantity in QUANTITIES.items():
        value = np.asarray(values.get(name, quantity.default), float)
        out[name] = np.broadcast_to(value, (2, 2) if quantity.by_direction else (2,))
    return FrictionParameters(**out)


def sticking(arm: Arm | None = None, *, timestep: float = 1e-3, **changes: Any) -> StickingModel:
    return build(gyro() if arm is None else arm, friction(**changes), timestep=timestep)


def law_of(model: StickingModel, joint: int, *, side: int = 0, load: float = 0.0) -> LuGre:
    """The numpy law of one joint (from 0) in one direction (0 +, 1 −)."""
    p = model.parameters
    return LuGre(
        stiction=p.stiction[joint, side],
        coulomb=p.stiction[joint, side] * p.coulomb_ratio[joint, side],
        stribeck_velocity=p.stribeck_velocity[joint, side],
        bristle_stiffness=p.bristle_stiffness[joint],
        bristle_damping=model.bristle_damping_of(p)[joint],
        viscous=p.viscous[joint, side],
        load_coefficient=p.load_coefficient[joint],
        load=load,
    )


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
        assert new.shape == old.shape, k
        scale = np.maximum(np.abs(old), 1e-3 * np.abs(old).max(initial=0.0))
        out[k] = float((np.abs(new - old) / np.maximum(scale, 1e-12)).max(initial=0.0))
    return out
