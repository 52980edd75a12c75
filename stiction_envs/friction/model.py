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

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import (
    FrictionParameters,
    bristle_damping,
    check_stability,
    load_friction,
)
from stiction_envs.friction.servos import PositionServos
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]
FEEDFORWARD = 4  # MjSpec's ctrlspec for <dcmotor input="ff">
MOTOR_CONSTANT = 1.0  # cancels out: with input="ff" the control is joint torque
# columns of actuator_biasprm and actuator_dynprm that hold the law (sources.md 3.5)
RIPPLE, COULOMB, STICTION, STRIBECK = 0, 3, 4, 5
BRISTLE_STIFFNESS, BRISTLE_DAMPING = 5, 6
NO_GRAVITY_NM = 0.02
"""Largest gravity torque under which a joint counts as one that sees none [N·m]; assumed."""
_POSES = 256
"""Random poses in which gravity is looked at [-]; assumed."""


@dataclass(frozen=True, kw_only=True, repr=False)
class StickingModel:
    """A compiled arm that sticks, and the indices of its joints."""

    arm: Arm
    parameters: FrictionParameters
    """Of one arm, fields (n,) or (n, 2)."""
    model: mujoco.MjModel
    motor: Index
    """(n,) dof (and qpos) of each joint's motor side."""
    spring: Index
    """(n,) dof of each joint's spring, −1 where the joint is rigid."""
    torque_actuator: Index
    """(n,) actuator whose control is joint torque."""
    servo_actuator: Index
    """(n,) actuator that holds the joint."""
    friction_inertia: Array
    """(n,) inertia that carries the friction: rotor, plus the link's if rigid [kg·m²]."""
    bearing: NDArray[np.bool_]
    """(n,) joints that see no gravity torque: their load is the bearing's tilting moment
    (`load_sensor`)."""
    timestep: float
    """Physics step [s]."""
    servos: PositionServos | None = None
    """Position servos that drive the joints, where its friction TOML has them."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.motor)

    def __repr__(self) -> str:
        return f"<StickingModel of {self.arm.name}, {self.n} joints>"

    def link_position(self, qpos: Array) -> Array:
        """Return (..., n) link angles [rad] from (..., nq) MuJoCo positions."""
        if qpos.ndim == 2:  # as in every control cycle
            out: Array = link_angles(qpos, self.motor, self.spring)
            return out
        rows = qpos.reshape(-1, qpos.shape[-1])
        out = link_angles(rows, self.motor, self.spring)
        return out.reshape(*qpos.shape[:-1], self.n)

    def one_link_position(self, qpos: Array, joint: Index) -> Array:
        """Return (M, K) angle [rad] of joint[m] (from 0) from (M, K, nq) MuJoCo positions."""
        rows = np.arange(len(qpos))
        q = qpos[rows, :, self.motor[joint]]
        spring = self.spring[joint]
        elastic = np.flatnonzero(spring >= 0)
        q[elastic] += qpos[elastic, :, spring[elastic]]
        return q

    def bristle_damping_of(self, parameters: FrictionParameters) -> Array:
        """Return (..., n) σ1 [N·m·s/rad] of other parameters on this model.

        Raises:
            StictionError: a bristle that would chatter with these parameters.
        """
        inertia = self.friction_inertia + (parameters.rotor_inertia - self.parameters.rotor_inertia)
        stiffness = parameters.bristle_stiffness
        damping = bristle_damping(
            stiffness, parameters.bristle_damping_ratio, inertia, self.timestep
        )
        check_stability(stiffness, damping, inertia, self.timestep)
        return damping


def _mass_and_gravity(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Return (M, n, n) [kg·m²] and (M, n) [N·m] of the rigid arm at poses q (M, n) [rad]."""
    model = arm.model()
    data = mujoco.MjData(model)
    mass, gravity = np.zeros((len(q), model.nv, model.nv)), np.empty((len(q), model.nv))
    for i, pose in enumerate(q):
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass[i])
        gravity[i] = data.qfrc_bias
    return mass, gravity


def mass_matrix(arm: Arm, q: Array) -> Array:
    """Return (M, n, n) rigid mass matrix [kg·m²] at poses q (M, n) [rad], without rotors."""
    return _mass_and_gravity(arm, q)[0]


def link_inertia(arm: Arm, q: Array) -> Array:
    """Return (M, n) diagonal of the rigid mass matrix [kg·m²] at poses q (M, n) [rad].

    The inertia that each joint moves when the others are locked, without rotors.
    """
    return np.diagonal(mass_matrix(arm, q), axis1=1, axis2=2).copy()


def _bearing_loaded(arm: Arm) -> NDArray[np.bool_]:
    """Return (n,) which joints see no gravity torque in any of a fixed set of random poses."""
    low, high = arm.limits.position.T
    q = np.random.default_rng(0).uniform(low, high, size=(_POSES, arm.n))
    weightless: NDArray[np.bool_] = np.abs(_mass_and_gravity(arm, q)[1]).max(axis=0) < NO_GRAVITY_NM
    return weightless


def build(
    arm: Arm, parameters: FrictionParameters | None = None, *, timestep: float = 1e-3
) -> StickingModel:
    """Build the model of an arm that sticks.

    Args:
        arm: the rigid arm.
        parameters: friction of one arm; None loads the TOML of that name.
        timestep: physics step, at most 1e-3 s.

    Raises:
        StictionError: step too long, parameters for another number of joints, or a bristle
            that would chatter at this step (sources.md 3.5).
    """
    if not 0 < timestep <= 1e-3:
        raise StictionError(f"timestep {timestep} s: expected 0 < timestep <= 0.001")
    if parameters is None:
        parameters = load_friction(arm.registered_name, arm.n)
    if parameters.n != arm.n:
        raise StictionError(f"friction of {parameters.n} joints, but {arm.name} has {arm.n}")
    elastic = parameters.elastic
    inertia = parameters.rotor_inertia + np.where(
        elastic, 0.0, link_inertia(arm, arm.rest[None])[0]
    )
    damping = bristle_damping(
        parameters.bristle_stiffness, parameters.bristle_damping_ratio, inertia, timestep
    )
    check_stability(parameters.bristle_stiffness, damping, inertia, timestep)

    spec = arm.spec()
    spec.option.timestep = timestep
    # implicit integrators add a phantom inertia h·σ1 to a sliding LuGre joint (sources.md 3.5)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for body in spec.bodies:
        body.gravcomp = 1.0
    for i, (joint_name, body_name) in enumerate(zip(arm.joint_names, arm.link_names, strict=True)):
        _make_joint_stick(spec, joint_name, body_name, parameters, i, float(damping[i]))
    for i, joint_name in enumerate(arm.joint_names):
        _add_servo(spec, joint_name, float(arm.limits.torque[i]))
    model = spec.compile()

    def dof(name: str) -> int:
        return int(model.joint(name).dofadr[0])

    springs = [
        dof(f"{j}_spring") if e else -1 for j, e in zip(arm.joint_names, elastic, strict=True)
    ]
    return StickingModel(
        arm=arm,
        parameters=parameters,
        model=model,
        motor=np.array([dof(j) for j in arm.joint_names]),
        spring=np.array(springs),
        torque_actuator=np.array([model.actuator(f"{j}_torque").id for j in arm.joint_names]),
        servo_actuator=np.array([model.actuator(f"{j}_servo").id for j in arm.joint_names]),
        friction_inertia=inertia,
        bearing=_bearing_loaded(arm),
        timestep=timestep,
    )


def _make_joint_stick(
    spec: mujoco.MjSpec,
    joint_name: str,
    body_name: str,
    parameters: FrictionParameters,
    i: int,
    sigma1: float,
) -> None:
    """Give one hinge its rotor, its spring if elastic, and the actuator with the friction."""
    joint = spec.joint(joint_name)
    rotor = float(parameters.rotor_inertia[i])
    joint.armature = rotor
    joint.damping = [float(parameters.viscous[i].mean()), 0.0, 0.0]
    joint.frictionloss = 0.0
    stiffness = float(parameters.joint_stiffness[i])
    if np.isfinite(stiffness):
        ratio = float(parameters.joint_damping_ratio[i])
        spring = spec.body(body_name).add_joint(name=f"{joint_name}_spring")
        spring.type = mujoco.mjtJoint.mjJNT_HINGE
        spring.axis, spring.pos = joint.axis, joint.pos
        spring.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spring.stiffness = [stiffness, 0.0, 0.0]
        spring.damping = [2 * ratio * np.sqrt(stiffness * rotor), 0.0, 0.0]
    # At rest; the plant writes load and direction per simulation.
    f_s = parameters.stiction_at(parameters.load_low)[i].mean()
    f_c = float(f_s * parameters.coulomb_ratio[i].mean())
    cogging = [
        float(parameters.ripple_amplitude[i]),
        float(parameters.ripple_periods[i]),
        float(parameters.ripple_phase[i]),
    ]
    actuator = spec.add_actuator(
        name=f"{joint_name}_torque", target=joint_name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    actuator.set_to_dcmotor(
        [MOTOR_CONSTANT, 0.0],
        1.0,
        cogging=cogging,
        lugre=[
            float(parameters.bristle_stiffness[i]),
            sigma1,
            f_c,
            float(f_s),
            float(parameters.stribeck_velocity[i].mean()),
        ],
        ctrlspec=FEEDFORWARD,
    )


def _add_servo(spec: mujoco.MjSpec, joint_name: str, torque_limit: float) -> None:
    servo = spec.add_actuator(
        name=f"{joint_name}_servo", target=joint_name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    servo.set_to_position(kp=0.0, kv=0.0)
    servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    servo.forcerange = [-torque_limit, torque_limit]


@compiled
def link_angles(qpos: Array, motor: Index, spring: Index) -> Array:
    """Return (M, n) motor angle, plus the spring's where there is one, of (M, nq)."""
    out = np.empty((len(qpos), len(motor)))
    for i in range(len(qpos)):
        for j in range(len(motor)):
            out[i, j] = qpos[i, motor[j]]
            if spring[j] >= 0:
                out[i, j] += qpos[i, spring[j]]
    return out
