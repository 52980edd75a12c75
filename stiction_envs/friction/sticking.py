"""Build the model of an arm that sticks from names, files or objects; find its friction file."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.friction.from_file import from_file, own_friction
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import (
    CONTROL_DT,
    QUANTITIES,
    FrictionParameters,
    friction_path,
    load_friction,
)
from stiction_envs.friction.servos import read_servos
from stiction_envs.robots import Arm, load_arm

Robot = str | Path | Arm | StickingModel
"""Name or model file of an arm, the arm, or an arm with its friction (`load_model`)."""
Friction = str | Path | FrictionParameters  # Parameters of one arm, or the TOML that holds them


def friction_file(arm: Arm, given: str | Path | None = None) -> Path:
    """Return the friction TOML that is used: the one given, the robot's, or the generic one.

    Raise a StictionError where ``given`` is not a path to a TOML.
    """
    if given is None:
        return friction_path(arm.registered_name)
    if Path(given).suffix != ".toml":
        raise StictionError(f"friction file {given}: expected a path to a .toml")
    return Path(given)


def friction_origin(robot: Robot, friction: Friction | None) -> Path | FrictionParameters:
    """Return the TOML that the friction of `sticking_model` is from, or parameters without one.

    Friction of the robot's own MJCF or URDF has no TOML.
    """
    if friction is None and isinstance(robot, StickingModel):
        return robot.parameters
    if isinstance(friction, FrictionParameters):
        return friction
    arm = arm_of(robot)
    return (
        own_friction(arm) if friction is None and from_file(arm) else friction_file(arm, friction)
    )


def friction_of(arm: Arm, given: Friction | None = None) -> FrictionParameters:
    """Return the friction of an arm, by default the arm's.

    Raise a StictionError for an unreadable file, or one of another number of joints.
    """
    origin = friction_origin(arm, given)
    return origin if isinstance(origin, FrictionParameters) else load_friction(origin, arm.n)


def arm_of(robot: Robot) -> Arm:
    """Return the arm of a name, a model file or a model."""
    if isinstance(robot, StickingModel):
        return robot.arm
    return robot if isinstance(robot, Arm) else load_arm(robot)


def sticking_model(
    robot: Robot, friction: Friction | None = None, *, timestep: float | None = None
) -> StickingModel:
    """Return an arm with its friction as a model.

    Args:
        robot: the arm; a model keeps its friction.
        friction: replaces the arm's friction; a TOML may have position servos too.
        timestep: physics step [s]; None for the model's step, or 1 ms.

    Raises:
        StictionError: an arm or friction that cannot be loaded, or that do not match.
    """
    arm, servos = arm_of(robot), None
    if isinstance(friction, str | Path):
        servos = read_servos(friction_file(arm, friction), arm.n)
    own_step = robot.timestep if isinstance(robot, StickingModel) else CONTROL_DT
    step = own_step if timestep is None else timestep
    if isinstance(robot, StickingModel) and friction is None:
        if step == robot.timestep:
            return robot
        friction, servos = robot.parameters, robot.servos
    return replace(build(arm, friction_of(arm, friction), timestep=step), servos=servos)


def with_rotors(friction: FrictionParameters, arm: Arm) -> FrictionParameters:
    """Return friction of an arm in which missing rotor inertias are those of its own friction.

    Joint torques behind the gear do not show rotors. Without a rotor the bristle of a joint shakes
    a light link: σ1 is chosen for the inertia of the rest pose, and other poses have less.
    """
    own = friction_of(arm).rotor_inertia
    known = friction.rotor_inertia > 0
    return friction.replace(rotor_inertia=np.where(known, friction.rotor_inertia, own))


def model_sha256(sticking: StickingModel) -> str:
    """Return a hash of the arm and its friction."""
    digest = hashlib.sha256(sticking.arm.xml.encode())
    for name in QUANTITIES:
        digest.update(repr(getattr(sticking.parameters, name).tolist()).encode())
    digest.update(repr(sticking.timestep).encode())
    return digest.hexdigest()


def check_torque_driven(sticking: StickingModel, who: str) -> None:
    """Raise a StictionError where an arm has position servos that ``who`` cannot drive."""
    if sticking.servos is not None:
        raise StictionError(
            f"{who} drive joints by torque, but this arm's friction TOML has position servos "
            "([servo]): expected friction without that table, or a Single Joint Experiment"
        )
