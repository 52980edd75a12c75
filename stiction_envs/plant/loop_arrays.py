"""Arrays of a plant's simulations that compiled code reads and writes, one simulation at a time."""

from __future__ import annotations

from typing import NamedTuple

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.robots.stated import COULOMB, STICTION, STRIBECK


class PlantArrays(NamedTuple):
    """Live arrays of N simulations of n joints; the engine has C actuators and V speeds."""

    state: Array  # (N, S) the engine's states
    qpos: int  # Column of the first position in `state`
    qvel: int  # Column of the first speed in `state`
    torque: int  # Column of the first joint's torque in `state`
    motor: Index  # (n,) position of each joint's motor hinge
    spring: Index  # (n,) position of each joint's spring hinge, −1 for a rigid joint
    substeps: int  # Physics steps of a control step
    asymmetric: bool  # Whether friction differs between the directions
    actuator: Index  # (n,) the actuators that have the joints' friction
    moving_up: Bools  # (N, n) whether a joint's last motion was upwards
    level: Array  # (N, n, 2) present stiction of each direction [N·m]
    viscous: Array  # (N, n, 2) present viscous friction of each direction [N·m·s/rad]
    coulomb_ratio: Array  # (N, n, 2) Coulomb friction over stiction [-]
    stribeck: Array  # (N, n, 2) Stribeck velocity [rad/s]
    bias: Array  # (N, C, parameters) of the actuators, written
    damping: Array  # (N, V) of the hinges, written [N·m·s/rad]
    passive: Array
    gravity: Array
    actuated: Array
    acceleration: Array
    """(N, V) the engine's ``qfrc_passive``, ``qfrc_gravcomp``, ``qfrc_actuator`` [N·m] and
    ``qacc`` [rad/s²]; empty where `write_joint_torque` is not used."""
    rotor: Array  # (N, n) rotor inertia [kg·m²]


@inlined
def write_links(i: int, first: int, a: PlantArrays, out: Array) -> None:
    """Write link angles or speeds (n,) of simulation ``i``, from columns of `state` on."""
    for j in range(len(out)):
        out[j] = a.state[i, first + a.motor[j]]
        if a.spring[j] >= 0:
            out[j] += a.state[i, first + a.spring[j]]


@compiled
def write_joint_torque(i: int, a: PlantArrays, out: Array) -> None:
    """Write the torque (n,) behind the gears of simulation ``i`` [N·m].

    It is what a torque sensor there reads less the weight that the robot compensates: of an elastic
    joint the spring's, of a rigid one what friction and rotor leave. What `Plant.offset` balances
    is no part of it.
    """
    for j in range(len(out)):
        k = a.spring[j]
        if k >= 0:
            out[j] = a.passive[i, k] - a.gravity[i, k]
        else:
            k = a.motor[j]
            out[j] = a.actuated[i, k] + (a.passive[i, k] - a.gravity[i, k])
            out[j] -= a.rotor[i, j] * a.acceleration[i, k]


@compiled
def write_direction(i: int, a: PlantArrays) -> None:
    """Give the joints of simulation ``i`` the friction of the direction in which they move."""
    for j in range(len(a.motor)):
        v = a.state[i, a.qvel + a.motor[j]]
        if v != 0.0:  # a joint at rest keeps the level of its last direction
            a.moving_up[i, j] = v > 0.0
        side = 0 if a.moving_up[i, j] else 1
        level, actuator = a.level[i, j, side], a.actuator[j]
        a.bias[i, actuator, COULOMB] = level * a.coulomb_ratio[i, j, side]
        a.bias[i, actuator, STICTION] = level
        a.bias[i, actuator, STRIBECK] = a.stribeck[i, j, side]
        a.damping[i, a.motor[j]] = a.viscous[i, j, side]


@compiled
def write_directions(ids: Index, a: PlantArrays) -> None:
    """Run `write_direction` for simulations ``ids`` (M,)."""
    for i in ids:
        write_direction(i, a)
