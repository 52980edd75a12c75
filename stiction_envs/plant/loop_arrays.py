"""Arrays of a plant's simulations that compiled code reads and writes, one simulation at a time."""

from typing import NamedTuple

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.friction.load_sensor import LoadSensor, read_load
from stiction_envs.friction.parameters import CONTROL_DT
from stiction_envs.robots.stated import COULOMB, STICTION, STRIBECK

SLOW_STEPS = 50  # Control steps between two updates of load, warm-up and offset


class FrictionArrays(NamedTuple):
    """Quantities of `FrictionParameters` of N simulations, (N, n) or (N, n, 2)."""

    stiction: Array
    coulomb_ratio: Array
    stribeck_velocity: Array
    viscous: Array
    load_coefficient: Array
    load_low: Array
    load_high: Array
    offset: Array
    gravity_error: Array
    warm_up_friction: Array
    warm_up_viscous: Array
    warm_up_time: Array
    rotor_inertia: Array


class PlantArrays(NamedTuple):
    """Live arrays of N simulations of n joints; the engine has C actuators and V speeds."""

    state: Array  # (N, S) the engine's states
    qpos: int  # Column of the first position in `state`
    qvel: int  # Column of the first speed in `state`
    torque: int  # Column of the first joint's torque in `state`
    motor: Index  # (n,) position of each joint's motor hinge
    spring: Index  # (n,) position of each joint's spring hinge, −1 for a rigid joint
    substeps: int  # Physics steps of a control step
    asymmetric: Bools  # (1,) whether friction differs between the directions
    steps: Index  # (N,) control steps since the reset, written
    load: LoadSensor
    friction: FrictionArrays
    factor: Array  # (N, n) of the dry friction [-]
    actuator: Index  # (n,) the actuators that have the joints' friction
    moving_up: Bools  # (N, n) whether a joint's last motion was upwards
    level: Array  # (N, n, 2) present stiction of each direction, written [N·m]
    viscous: Array  # (N, n, 2) present viscous friction of each direction, written [N·m·s/rad]
    applied: Array  # (N, V) torque on the hinges that no actuator makes, written [N·m]
    bias: Array  # (N, C, parameters) of the actuators, written
    damping: Array  # (N, V) of the hinges, written [N·m·s/rad]


@inlined
def write_links(i: int, first: int, a: PlantArrays, out: Array) -> None:
    """Write link angles or speeds (n,) of simulation ``i``, from columns of `state` on."""
    for j in range(len(out)):
        out[j] = a.state[i, first + a.motor[j]]
        if a.spring[j] >= 0:
            out[j] += a.state[i, first + a.spring[j]]


@compiled
def write_slow(i: int, a: PlantArrays) -> None:
    """Write the friction of simulation ``i`` at its present load, warm-up and offset.

    That of the positive direction goes to the engine; see `write_direction`.
    """
    p, time = a.friction, a.steps[i] * CONTROL_DT
    for j in range(len(a.motor)):
        signed, high = read_load(i, j, a.load), p.load_high[i, j]
        growth = p.load_coefficient[i, j] * min(max(abs(signed), p.load_low[i, j]), high)
        cold = np.exp(-time / p.warm_up_time[i, j])
        dry = a.factor[i, j] * (1.0 + p.warm_up_friction[i, j] * cold)
        for side in range(2):
            least = 1e-3 * p.stiction[i, j, side]
            a.level[i, j, side] = max(p.stiction[i, j, side] + growth, least) * dry
            warm = 1.0 + p.warm_up_viscous[i, j] * cold
            a.viscous[i, j, side] = p.viscous[i, j, side] * warm
        # the offset acts on the link: on both hinges of an elastic joint
        offset = offset_at(i, j, signed, p)
        a.applied[i, a.motor[j]] = -offset
        if a.spring[j] >= 0:
            a.applied[i, a.spring[j]] = -offset
        if not a.asymmetric[0]:
            _write_side(i, j, 0, a)


@inlined
def offset_at(i: int, j: int, signed: float, p: FrictionArrays) -> float:
    """Return the offset of a joint under a load [N·m]; not extrapolated past the loads measured."""
    high = p.load_high[i, j]
    return p.offset[i, j] + p.gravity_error[i, j] * min(max(signed, -high), high)


@compiled
def write_direction(i: int, a: PlantArrays) -> None:
    """Give the joints of simulation ``i`` the friction of the direction in which they move."""
    for j in range(len(a.motor)):
        v = a.state[i, a.qvel + a.motor[j]]
        if v != 0.0:  # a joint at rest keeps the level of its last direction
            a.moving_up[i, j] = v > 0.0
        _write_side(i, j, 0 if a.moving_up[i, j] else 1, a)


@inlined
def _write_side(i: int, j: int, side: int, a: PlantArrays) -> None:
    """Give a joint of simulation ``i`` the friction of a direction: 0 is +, 1 is −."""
    level, actuator = a.level[i, j, side], a.actuator[j]
    a.bias[i, actuator, COULOMB] = level * a.friction.coulomb_ratio[i, j, side]
    a.bias[i, actuator, STICTION] = level
    a.bias[i, actuator, STRIBECK] = a.friction.stribeck_velocity[i, j, side]
    a.damping[i, a.motor[j]] = a.viscous[i, j, side]


@compiled
def write_friction(ids: Index, period: int, a: PlantArrays) -> None:
    """Write the friction of simulations ``ids`` (M,) before a control step.

    What changes slowly is written every ``period`` control steps of a simulation.
    """
    for i in ids:
        if a.steps[i] % period == 0:
            write_slow(i, a)
        if a.asymmetric[0]:
            write_direction(i, a)
