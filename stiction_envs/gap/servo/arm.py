"""The whole arm under position servos, simulated by the plant along the commands of logs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.friction.model import StickingModel, build, link_inertia
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.gap.servo import joint as lone
from stiction_envs.gap.servo.parameters import FAR, INDEX
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
BLOCK = 2000
"""Control steps simulated at once [-]; bounds the memory."""
DEAD_STEPS = 5
"""Control steps for which a dead zone is held [-]: a servo's own cycle is longer; assumed."""
ROOM = 0.2
"""Least distance of the model's joint limits from the logged angles [rad]: zeros may be off."""


def friction_of(arm: Arm, parameters: Array, load: Array) -> FrictionParameters:
    """Return the friction of an arm from the parameters of its joints.

    Args:
        arm: the rigid arm.
        parameters: (n, P), in the order of `parameters.NAMES`.
        load: (n,) usual size of gravity [N·m], at which the bristles yield where it is said.
    """

    def of(name: str) -> Array:
        out: Array = parameters[:, INDEX[name]]
        return out

    def both(values: Array) -> Array:
        return np.stack([values, values], axis=1)

    h = lone.STEP
    inertia = link_inertia(arm, arm.rest[None])[0]
    rotor = np.maximum(of("armature"), lone.SLOWEST * h * h * of("stiffness") - inertia)
    level = np.maximum(of("stiction"), 1e-6)
    usual = np.maximum(level + of("load") * load, 1e-6)
    bristle = np.minimum(usual / of("bristle"), lone.STIFFEST * (rotor + inertia) / (h * h))
    plain = {k: np.full(arm.n, q.default) for k, q in QUANTITIES.items() if q.default is not None}
    found = dict(
        stiction=both(level),
        coulomb_ratio=both(1.0 - of("drop")),
        stribeck_velocity=both(of("stribeck_velocity")),
        viscous=both(of("damping")),
        load_coefficient=of("load").copy(),
        bristle_stiffness=np.maximum(bristle, 1e-3),
        bristle_damping_ratio=np.full(arm.n, lone.BRISTLE_DAMPING_RATIO),
        rotor_inertia=np.maximum(rotor, 0.0),
        gravity_error=-of("compensation"),
    )
    return FrictionParameters(**{**plain, **found})


def sticking_arm(arm: Arm, parameters: Array, load: Array) -> StickingModel:
    """Return the arm with its friction, under gravity, its servos limited."""
    sticking = build(arm, friction_of(arm, parameters, load), timestep=CONTROL_DT)
    sticking.model.body_gravcomp[:] = 0.0
    limit = np.minimum(parameters[:, INDEX["torque_limit"]], FAR)
    sticking.model.actuator_forcerange[sticking.servo_actuator] = np.stack([-limit, limit], axis=1)
    return sticking


def simulate_arm(
    arm: Arm, logs: Sequence[ServoLog], parameters: Array, load: Array, *, threads: int = 0
) -> list[Array]:
    """Return the simulated angles at the rows of each log's segments.

    Args:
        arm: the rigid arm.
        logs: of it; every segment starts at rest at its first measured angles.
        parameters: (n, P) of its joints.
        load: (n,) usual size of gravity [N·m].
        threads: threads, 0 for all processors.

    Returns:
        Per log, (T, n) angles [rad]; rows of segments of one row are NaN.

    Raises:
        ExperimentError: a simulation that the engine stopped.
    """
    parts = [(k, s) for k, log in enumerate(logs) for s in log.segments if s.stop - s.start > 1]
    out = [np.full_like(log.q, np.nan) for log in logs]
    offset = parameters[:, INDEX["offset"]]
    q = np.concatenate([log.q for log in logs]) - offset
    arm = _within(arm, q.min(axis=0), q.max(axis=0))
    sticking = sticking_arm(arm, parameters, load)
    longest = max(float(np.ptp(logs[k].t[s])) for k, s in parts)
    steps = int(np.ceil(longest / CONTROL_DT)) + 1
    plant = Plant(sticking, len(parts), threads=threads)
    start = np.stack([logs[k].q[s.start] - offset for k, s in parts])
    plant.reset(np.arange(len(parts)), start)
    stiffness = np.tile(parameters[:, INDEX["stiffness"]], (len(parts), 1))
    reference = np.stack([_references(logs[k], s, parameters, steps) for k, s in parts]) - offset
    plant.set_servo(np.arange(len(parts)), stiffness, np.zeros_like(stiffness), start)
    _preload(plant, reference[:, 0], start, parameters)
    dead = parameters[:, INDEX["dead_zone"]]
    angle = np.empty((len(parts), steps + 1, arm.n))
    angle[:, 0] = start
    block = DEAD_STEPS if dead.any() else BLOCK
    torque = np.zeros((len(parts), block, arm.n))
    for k in range(0, steps, block):
        setpoint = reference[:, k : k + block]
        if dead.any():  # the error loses the dead zone
            error = setpoint - angle[:, k : k + 1]
            setpoint = setpoint - np.clip(error, -dead, dead)
        m = setpoint.shape[1]
        angle[:, k + 1 : k + 1 + m] = plant.run(torque[:, :m], setpoint=setpoint)
    grid = np.arange(steps + 1) * CONTROL_DT
    for (k, s), found in zip(parts, angle, strict=True):
        t = logs[k].t[s] - logs[k].t[s.start]
        for j in range(arm.n):
            out[k][s, j] = np.interp(t, grid, found[:, j]) + offset[j]
    return out


def _within(arm: Arm, low: Array, high: Array) -> Arm:
    """Return the arm with joint limits that leave room around logged angles."""
    position = arm.limits.position.copy()
    position[:, 0] = np.minimum(position[:, 0], low - ROOM)
    position[:, 1] = np.maximum(position[:, 1], high + ROOM)
    if np.array_equal(position, arm.limits.position):
        return arm
    return dataclasses.replace(arm, limits=dataclasses.replace(arm.limits, position=position))


def _references(log: ServoLog, s: slice, parameters: Array, steps: int) -> Array:
    """Return (steps, n) what the servos follow: late and limited in speed [rad]."""
    t = log.t[s] - log.t[s.start]
    nodes = np.concatenate([[-lone.STEP - 1.0], t, [max(t[-1], steps * CONTROL_DT) + 1.0]])
    out = np.empty((steps, log.n))
    for j in range(log.n):
        held = np.concatenate([[log.q_cmd[s.start, j]], log.q_cmd[s, j]])
        integral = np.concatenate([[0.0], np.cumsum(held * np.diff(nodes))])
        late = np.arange(steps + 1) * CONTROL_DT - parameters[j, INDEX["delay"]]
        mean = np.diff(np.interp(late, nodes, integral)) / CONTROL_DT
        # a command later than the log's first is not known: the first counts
        early = late[:-1] < nodes[0]
        mean[early] = held[0]
        out[:, j] = _limited(mean, parameters[j, INDEX["speed_limit"]] * CONTROL_DT)
    return out


@compiled
def _limited(values, most):  # type: ignore[no-untyped-def]
    """Return values whose change per step is at most ``most``, from the first."""
    out = values.copy()
    for k in range(1, len(out)):
        out[k] = out[k - 1] + max(-most, min(most, values[k] - out[k - 1]))
    return out


def _preload(plant: Plant, reference: Array, start: Array, parameters: Array) -> None:
    """Let the bristles of joints at rest carry what they can of servo and gravity."""
    gravity = plant.load[0] * (1.0 - parameters[:, INDEX["compensation"]])
    gravity = np.where(plant.sticking.bearing, 0.0, gravity)
    error = reference - start
    dead, limit = parameters[:, INDEX["dead_zone"]], parameters[:, INDEX["torque_limit"]]
    error = error - np.clip(error, -dead, dead)
    push = np.clip(parameters[:, INDEX["stiffness"]] * error, -limit, limit) - gravity
    friction = plant.sticking.parameters
    level = plant.stiction
    deflection = np.clip(push, -level, level) / friction.bristle_stiffness
    model = plant.sticking.model
    plant.batch.bind("act")[:, model.actuator_actadr[plant.sticking.torque_actuator]] = deflection
