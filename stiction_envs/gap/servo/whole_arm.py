"""The whole arm under position servos, simulated by the plant along logs, and its errors."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Bools
from stiction_envs.control.position_servo import ServoDrive, put_under_servos
from stiction_envs.friction.inertia import link_inertia
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.friction.servos import PositionServos
from stiction_envs.friction.steady import steady
from stiction_envs.gap.judge.judgement import ModelCheck
from stiction_envs.gap.servo import joint as lone
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import segments
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_parameters import FAR, INDEX, NAMES
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.robots import Arm
from stiction_envs.robots.mjcf import numbers

BLOCK = 2000
"""Control steps simulated at once [-]; bounds the memory."""
ROOM = 0.2
"""Least distance of the model's joint limits from the logged angles [rad]: zeros may be off."""
FOLD_SECONDS = 10.0
"""Length of the blocks of time that are held out in turn [s]; assumed."""
WORSE = 1.1
"""Least error of the extended model over the nominal one that is worse [-]; assumed."""


def friction_of(arm: Arm, parameters: Array, load: Array) -> FrictionParameters:
    """Return the friction of a rigid arm from (n, P) parameters of its joints.

    ``load`` (n,) is the usual size of gravity [N·m], for which the bristles are as stiff as found.
    """

    of, h = dict(zip(NAMES, parameters.T, strict=True)), lone.STEP

    def both(values: Array) -> Array:
        return np.stack([values, values], axis=1)

    at_rest = link_inertia(arm, arm.rest[None])[0]
    rotor = np.maximum(of["armature"], lone.SLOWEST * h * h * of["stiffness"] - at_rest)
    rotor = np.maximum(rotor, 0.0)
    level = np.maximum(of["stiction"], 1e-6)
    usual = np.maximum(level + of["load"] * load, 1e-6)
    # the joint's inertia at rest bounds the fit; in other poses a step may hold less
    bristle = np.minimum(usual / of["bristle"], lone.STIFFEST * (rotor + at_rest) / h**2)
    plain = {k: np.full(arm.n, q.default) for k, q in QUANTITIES.items() if q.default is not None}
    found = dict(
        stiction=both(level),
        coulomb_ratio=both(1.0 - of["drop"]),
        stribeck_velocity=both(of["stribeck_velocity"]),
        viscous=both(of["damping"]),
        load_coefficient=of["load"].copy(),
        bristle_stiffness=np.maximum(bristle, 1e-3),
        bristle_damping_ratio=np.full(arm.n, lone.BRISTLE_DAMPING_RATIO),
        rotor_inertia=rotor,
        gravity_error=-of["compensation"],
    )
    return steady(FrictionParameters(**{**plain, **found}), arm)


def reaching(arm: Arm, logs: Sequence[ServoLog], offset: Array | float = 0.0) -> Arm:
    """Return the arm with joint limits that leave room around the angles of its logs.

    A model may end before the robot's stops. ``offset`` (n,) is that of the logged angles [rad].
    """
    q = np.concatenate([log.q for log in logs]) - offset
    limits = arm.limits.position.copy()
    limits[:, 0] = np.minimum(limits[:, 0], q.min(axis=0) - ROOM)
    limits[:, 1] = np.maximum(limits[:, 1], q.max(axis=0) + ROOM)
    if np.array_equal(limits, arm.limits.position):
        return arm
    root = ET.fromstring(arm.xml)
    compiler = root.find("compiler")
    degrees = compiler is None or compiler.get("angle", "degree") == "degree"
    for joint in root.iter("joint"):
        if joint.get("name") in arm.joint_names and joint.get("range"):
            ends = limits[arm.joint_names.index(str(joint.get("name")))]
            joint.set("range", numbers(np.degrees(ends) if degrees else ends))
    return replace(
        arm,
        xml=ET.tostring(root, encoding="unicode"),
        limits=replace(arm.limits, position=limits),
    )


def simulate_arm(
    arm: Arm, logs: Sequence[ServoLog], parameters: Array, load: Array, *, threads: int = 0
) -> list[Array]:
    """Return per log the (T, n) simulated angles [rad]; rows of segments of one row are NaN.

    Args:
        arm: the rigid arm.
        logs: every segment starts at rest at its first measured angles.
        parameters: (n, P) of its joints.
        load: (n,) usual size of gravity [N·m].
        threads: threads, 0 for all processors.

    Raises:
        ExperimentError: a simulation that the engine stopped.
    """
    parts = segments(logs)
    out = [np.full_like(log.q, np.nan) for log in logs]
    offset = parameters[:, INDEX["offset"]]
    arm = reaching(arm, logs, offset)
    sticking = build(arm, friction_of(arm, parameters, load), timestep=CONTROL_DT)
    names = ("stiffness", "speed_limit", "torque_limit", "dead_zone")
    values = {name: np.minimum(parameters[:, INDEX[name]], FAR) for name in names}
    servos = PositionServos(delay=np.zeros(arm.n), **values)  # the commands are late already
    put_under_servos(sticking, servos)
    longest = max(float(np.ptp(logs[k].t[s])) for k, s in parts)
    steps = int(np.ceil(longest / CONTROL_DT)) + 1
    plant, ids = Plant(sticking, len(parts), threads=threads), np.arange(len(parts))
    drive = ServoDrive(servos, plant)
    start = np.stack([logs[k].q[s.start] - offset for k, s in parts])
    command = np.stack([_late(logs[k], s, parameters, steps) for k, s in parts]) - offset
    plant.reset(ids, start)
    drive.reset(ids, command[:, 0])
    _preload(plant, command[:, 0], start, parameters)
    angle = np.empty((len(parts), steps + 1, arm.n))
    angle[:, 0] = start
    for k in range(0, steps, BLOCK):
        part = command[:, k : k + BLOCK]
        angle[:, k + 1 : k + 1 + part.shape[1]] = drive.run(part, ids)
    grid = np.arange(steps + 1) * CONTROL_DT
    for (k, s), found in zip(parts, angle, strict=True):
        t = logs[k].t[s] - logs[k].t[s.start]
        for j in range(arm.n):
            out[k][s, j] = np.interp(t, grid, found[:, j]) + offset[j]
    return out


def _late(log: ServoLog, s: slice, parameters: Array, steps: int) -> Array:
    """Return (steps, n) commands at the steps at which they act [rad]."""
    t = log.t[s] - log.t[s.start]
    after = max(t[-1], steps * CONTROL_DT) + 1.0
    out = np.empty((steps, log.n))
    for j in range(log.n):
        times, integral = lone.command_nodes(t, log.q_cmd[s, j], -lone.STEP - 1.0, after)
        late = np.arange(steps + 1) * CONTROL_DT - parameters[j, INDEX["delay"]]
        out[:, j] = np.diff(np.interp(late, times, integral)) / CONTROL_DT
    return out


def _preload(plant: Plant, reference: Array, start: Array, parameters: Array) -> None:
    """Let the bristles of joints at rest carry what they can of servo and gravity."""
    gravity = plant.load[0] * (1.0 - parameters[:, INDEX["compensation"]])
    gravity = np.where(plant.sticking.bearing, 0.0, gravity)
    dead, limit = parameters[:, INDEX["dead_zone"]], parameters[:, INDEX["torque_limit"]]
    error = reference - start
    error = error - np.clip(error, -dead, dead)
    push = np.clip(parameters[:, INDEX["stiffness"]] * error, -limit, limit) - gravity
    level, model = plant.stiction, plant.sticking.model
    deflection = np.clip(push, -level, level) / plant.sticking.parameters.bristle_stiffness
    plant.batch.bind("act")[:, model.actuator_actadr[plant.sticking.torque_actuator]] = deflection


def folds(motion: JointMotion) -> list[Bools]:
    """Return two halves of the rows, in alternating blocks of time."""
    even = (motion.since // FOLD_SECONDS + motion.segment) % 2 == 0
    return [even, ~even]


def rows(logs: Sequence[ServoLog], angles: Sequence[Array]) -> Array:
    """Return the rows of all segments, as motions have them."""
    return np.concatenate([angles[k][s] for k, s in segments(logs)])


def per_log(logs: Sequence[ServoLog], values: NDArray[Any], other: float) -> list[NDArray[Any]]:
    """Return per log the values of the rows of all segments; those of other rows are ``other``."""
    out = [np.full((len(log.t), *values.shape[1:]), other, dtype=values.dtype) for log in logs]
    begin = 0
    for k, s in segments(logs):
        end = begin + s.stop - s.start
        out[k][s] = values[begin:end]
        begin = end
    return out


def nominal_angles(
    arm: Arm, logs: Sequence[ServoLog], servo: Servo, nominal: Array, load: Array
) -> Array:
    """Return (R, n) angles of the simulation that is judged, at the rows of all segments [rad]."""
    if servo.perfect:
        return rows(logs, [log.q_cmd for log in logs])
    return rows(logs, simulate_arm(arm, logs, nominal, load, threads=1))


def errors_of(
    logs: Sequence[ServoLog], angles: Array, counts: Bools | slice = slice(None)
) -> Array:
    """Return (n,) root mean square error of (R, n) angles over the rows that count [rad]."""
    error = rows(logs, [log.q for log in logs]) - angles
    return np.asarray(np.sqrt(np.nanmean(error[counts] ** 2, axis=0)))


def check_model(
    logs: Sequence[ServoLog], plain: Array, model: Array, fitted_rms: Array
) -> ModelCheck:
    """Return the errors of both models on logs that took no part.

    ``plain`` and ``model`` are (R, n) angles of the nominal simulation and of the extended model
    [rad]; ``fitted_rms`` (n,) is the held-out error where the model was fitted [rad].
    """
    before, after = errors_of(logs, plain), errors_of(logs, model)
    worse = np.flatnonzero((after > WORSE * before) & (after > fitted_rms))
    joints = tuple(int(j) + 1 for j in worse)
    return ModelCheck(nominal_rms=before, extended_rms=after, worse_joints=joints, unit="rad")
