"""A control step of the Generated Trajectory Experiment, and many of them, in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import Arguments, compiled
from stiction_envs.control.compensation import compensate
from stiction_envs.control.kernels import (
    advance_reference,
    impedance_cycle,
    pass_torque,
    site_kinematics,
)
from stiction_envs.control.operational import renew
from stiction_envs.control.sensing_kernels import send
from stiction_envs.control.trapezoid import accept, write_sample
from stiction_envs.dither.dither import sine
from stiction_envs.experiments.gte.controller_model import ModelArrays, renew_dynamics
from stiction_envs.friction.model import link_angles
from stiction_envs.plant import CONTROL_DT
from stiction_envs.plant.loop_batch import advance

Array = NDArray[np.float64]
Index = NDArray[np.int64]


PathArrays = tuple[Array, float, Array, Array, Array]


class JointArrays(NamedTuple):
    """State of N arms, and which of its entries are the joints'."""

    qpos: Array
    """(N, nq) [rad]."""
    qvel: Array
    """(N, nv) [rad/s]."""
    motor: Index
    spring: Index
    """As in `link_angles`."""


class SeenArrays(NamedTuple):
    """What the controller has measured of N arms, and how its commands get to them."""

    active: bool
    """False: it has the plant's own state, and its commands act at once."""
    pose: tuple[Array, Array, Array]
    """Position (N, 3), quaternion (N, 4) and Jacobian (N, 6, n) at the angles that it has."""
    q: Array
    """(N, n) [rad]."""
    dq: Array
    """(N, n) [rad/s]."""
    torque: Array
    """(N, n) [N·m]."""
    line: Arguments
    """The last of `sensing_kernels.send`; what arrives is its last."""


class DitherArrays(NamedTuple):
    """The dither, as far as it is sines."""

    only_sines: bool
    """Any other dither is in `torque` already."""
    omega: Array
    phase: Array
    amplitude: Array
    """As in `dither.dither.sine`."""
    torque: Array
    """(N, n) sines are written in every controller cycle [N·m]."""


class CompensationArrays(NamedTuple):
    """Compensation of the joints' friction."""

    active: bool
    """Whether any arm is compensated."""
    arguments: Arguments
    """The last of `compensate`, its result at the end."""
    added: Array
    """(N, n) dither and compensation together, written where active [N·m]."""


class AheadArrays(NamedTuple):
    """What renews the controller's model of the arm and its reference, in some of its cycles."""

    model_period: int
    goal_period: int
    """Control steps from one renewal to the next."""
    dynamics: ModelArrays
    space: Arguments
    """Of `renew` after the inertias."""
    goals: Arguments
    """Of `trapezoid.accept` between the times and its result."""
    accepted: NDArray[np.bool_]
    """(N,) its result."""
    reference: Arguments
    """Of `advance_reference`."""


class StepArrays(NamedTuple):
    """All that a control step reads and writes; the same objects while arms follow."""

    site: Arguments
    """Of `site_kinematics`; it writes the last three: position, quaternion, Jacobian."""
    joints: JointArrays
    seen: SeenArrays
    ahead: AheadArrays
    hold: int
    """Control steps of a controller's cycle."""
    step: Index
    """(N,) control steps since the arm began to follow."""
    dither: DitherArrays
    compensation: CompensationArrays
    impedance: Arguments
    """Of `impedance_cycle` behind the dither; the last is the command that it writes."""
    path: PathArrays
    """Of `pass_torque` between command and result."""
    missing: Array
    """(N, n) torque that acts besides, gravity compensated wrongly [N·m]."""
    applied: Array
    """(N, n) what the joints get of the command, written [N·m]."""
    torque: Array
    """(N, n) the sum of that and `missing`, written [N·m]."""
    poses: tuple[Array, Array]
    """(K, N, 3) positions [m] and (K, N, 4) quaternions of K control steps, written."""
    stride: int
    """Control steps of a sample."""
    sampled: Array
    """(S, N, 7) position [m] and quaternion of the reference in the first step of each, written."""


def of_arms(arrays: StepArrays, arms: slice, dynamics: ModelArrays) -> StepArrays:
    """Return what belongs to some arms, which have no senses; ``dynamics`` is of them alone."""

    def cut(arguments: Arguments, shared: tuple[int, ...] = ()) -> Arguments:
        """Return the arms' rows of arrays; those at places ``shared`` are all arms' in common."""
        return tuple(
            x[arms] if isinstance(x, np.ndarray) and k not in shared else x
            for k, x in enumerate(arguments)
        )

    ahead, compensation = arrays.ahead, arrays.compensation
    limits, goals, times, profile, trapezoid = ahead.goals
    return arrays._replace(
        site=cut(arrays.site, shared=(4, 5, 6)),  # joints, turn, tool
        joints=JointArrays(*cut(arrays.joints, shared=(2, 3))),  # motor, spring
        ahead=(
            ahead._replace(
                dynamics=dynamics,
                space=cut(ahead.space),
                goals=(limits, cut(goals), cut(times), profile, cut(trapezoid)),
                accepted=ahead.accepted[arms],
                reference=cut(ahead.reference),
            )
        ),
        seen=arrays.seen._replace(line=()),  # less to compile
        step=arrays.step[arms],
        dither=DitherArrays(*cut(arrays.dither)),
        compensation=CompensationArrays(
            compensation.active,
            cut(compensation.arguments),
            compensation.added[arms],
        ),
        impedance=cut(arrays.impedance, shared=(2,)),  # limit
        path=cut(arrays.path),
        missing=arrays.missing[arms],
        applied=arrays.applied[arms],
        torque=arrays.torque[arms],
        poses=(arrays.poses[0][:, arms], arrays.poses[1][:, arms]),
        sampled=arrays.sampled[:, arms],
    )


@compiled
def is_due(step: int, hold: int, period: int) -> bool:
    """Return whether the controller does in a step what it does once in a ``period``.

    It is held for ``hold`` steps, and takes at its next cycle what fell due since its last.
    """
    return step % hold == 0 and step % period < hold


@compiled
def look_ahead(
    model: bool,
    goals: bool,
    site: Arguments,
    joints: JointArrays,
    seen: SeenArrays,
    tick: Index,
    ahead: AheadArrays,
) -> None:
    """Renew the controller's model of the arm and its reference; the end effector has been read.

    ``tick`` (N,) is the control step of the last cycle, other arguments are of `StepArrays`.
    """
    position, quaternion, jacobian = site[-3], site[-2], site[-1]
    if seen.active:
        position, quaternion, jacobian = seen.pose
    if model:
        q = seen.q
        if not seen.active:
            q = link_angles(joints.qpos, joints.motor, joints.spring)
        renew_dynamics(q, ahead.dynamics)
        mass = ahead.dynamics.mass
        renew(np.arange(len(mass)), jacobian, mass, *ahead.space)
    if goals:
        limits, listed, times, profile, trapezoid = ahead.goals
        time = tick.astype(np.float64) * CONTROL_DT
        accept(
            position, quaternion, time, limits, listed, times, profile, trapezoid, ahead.accepted
        )
        clock, (share, place, turn) = time - times[2], ahead.reference[:3]
        velocity, speed = np.empty((len(clock), 3)), np.empty((len(clock), 2))
        write_sample(clock, profile, trapezoid, place, turn, velocity, speed)
        if share == 1.0:  # a filter moves the reference in every cycle
            advance_reference(*ahead.reference)


@compiled
def note_reference(row: int, stride: int, reference: Arguments, sampled: Array) -> None:
    """Write the reference, where a sample begins with control step ``row``."""
    if row % stride == 0:
        now = sampled[row // stride]
        now[:, :3], now[:, 3:] = reference[3], reference[4]


@compiled
def read_pose(row: int, site: Arguments, poses: tuple[Array, Array]) -> None:
    """Read the end effector, and note its pose."""
    site_kinematics(*site)
    positions, quaternions = poses
    positions[row], quaternions[row] = site[-3], site[-2]


@compiled
def compute_command(
    site: Arguments,
    joints: JointArrays,
    seen: SeenArrays,
    step: Index,
    dither: DitherArrays,
    compensation: CompensationArrays,
    impedance: Arguments,
) -> None:
    """Do a controller's cycle; arguments are of `StepArrays`."""
    if seen.active:
        position, quaternion, jacobian = seen.pose
        q, dq = seen.q, seen.dq
    else:
        position, quaternion, jacobian = site[-3], site[-2], site[-1]
        q = link_angles(joints.qpos, joints.motor, joints.spring)
        dq = link_angles(joints.qvel, joints.motor, joints.spring)
    if dither.only_sines:
        time = step.astype(np.float64) * CONTROL_DT
        sine(dither.omega, dither.phase, dither.amplitude, time, dither.torque)
    added = dither.torque
    if compensation.active:
        reference, error_matrix, stiffness = impedance[3], impedance[4], impedance[5]
        compensated = compensation.arguments
        compensate(
            *(position, quaternion, jacobian, dq, reference, error_matrix, stiffness),
            *compensated,
        )
        added = compensation.added
        for i in range(added.shape[0]):
            for j in range(added.shape[1]):
                added[i, j] = dither.torque[i, j] + compensated[-1][i, j]
    impedance_cycle(position, quaternion, jacobian, q, dq, added, *impedance)


@compiled
def apply_command(
    command: Array, path: PathArrays, missing: Array, applied: Array, torque: Array
) -> None:
    """Pass a command on to the joints; arguments are of `StepArrays`."""
    pass_torque(command, *path, applied)
    for i in range(torque.shape[0]):
        for j in range(torque.shape[1]):
            torque[i, j] = applied[i, j] + missing[i, j]


@compiled
def control_step(due: bool, row: int, arrays: StepArrays) -> None:
    """Read the end effector and, where ``due``, compute the next command; pass the command on.

    One call of compiled code: called one by one from Python, these functions would spend half of
    the time between their calls. Where not ``due``, the controller's command is held.

    Args:
        due: whether the controller computes in this step.
        row: where pose and reference are written.
        arrays: of the arms.
    """
    a = arrays
    read_pose(row, a.site, a.poses)
    if due:
        compute_command(a.site, a.joints, a.seen, a.step, a.dither, a.compensation, a.impedance)
    command = a.impedance[-1]
    if a.seen.active:
        send(due, a.step, command, a.seen.line)
        command = a.seen.line[-1]
    apply_command(command, a.path, a.missing, a.applied, a.torque)
    note_reference(row, a.stride, a.ahead.reference, a.sampled)


@compiled
def follow_steps(
    steps: int, first: int, row: int, looks: bool, arrays: StepArrays, loop: Arguments
) -> None:
    """Follow for control steps in which Python has nothing to do, without senses.

    Args:
        steps: number of control steps.
        first: number of the first since arms began to follow.
        row: its row in the poses.
        looks: whether to look ahead where due; else Python has done so.
        arrays: of some arms.
        loop: of these arms, of `Plant.compiled_loops`.
    """
    a, ahead, (torque, physics, substeps) = arrays, arrays.ahead, loop
    for k in range(first, first + steps):
        model, goals = is_due(k, a.hold, ahead.model_period), is_due(k, a.hold, ahead.goal_period)
        # as `control_step`, which would take over a hundred arrays in every call
        read_pose(row, a.site, a.poses)
        if looks and (model or goals):
            tick = a.step // a.hold * a.hold
            look_ahead(model, goals, a.site, a.joints, a.seen, tick, ahead)
        note_reference(row, a.stride, ahead.reference, a.sampled)
        if k % a.hold == 0:
            compute_command(a.site, a.joints, a.seen, a.step, a.dither, a.compensation, a.impedance)
        apply_command(a.impedance[-1], a.path, a.missing, a.applied, a.torque)
        row += 1
        for i in range(torque.shape[0]):
            a.step[i] += 1
            for j in range(torque.shape[1]):
                torque[i, j] = a.torque[i, j]
        advance(physics, substeps)
