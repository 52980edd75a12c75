"""The loop of the Generated Trajectory Experiment, in compiled code: control law and physics.

    sense -> pose -> model, goals (in some cycles) -> dither, compensation, impedance -> torque path
    -> physics

Arms are independent of each other, so each takes all control steps of a block before the next: its
state stays in the processor's cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.compensation import Compensations, compensate, look_ahead
from stiction_envs.control.impedance_kernels import (
    Impedance,
    advance_reference,
    impedance_cycle,
    read_flags,
    renew_space,
)
from stiction_envs.control.kinematics import Chain, Hand, follow_chain, read_hand
from stiction_envs.control.sensing_kernels import Measured, Sent, send_arm, sense_arm
from stiction_envs.control.torque_path import Path, pass_torque
from stiction_envs.control.trapezoid import Goals, Movement, accept, write_sample, write_twist
from stiction_envs.experiments.gte.controller_model import (
    ModelArrays,
    renew_dynamics,
    renew_torques,
)
from stiction_envs.plant import CONTROL_DT
from stiction_envs.plant.arrays import (
    PlantArrays,
    write_direction,
    write_joint_torque,
    write_links,
)
from stiction_envs.plant.loop_batch import Loop, advance, take_fields

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]


class Shaking(NamedTuple):
    """The dither of N arms while they follow for K control steps."""

    only_sines: bool
    """Whether the dither is ungated sines without offset: else `ungated` has the waveforms."""
    omega: Array
    phase: Array
    amplitude: Array
    """(N, n) of the sines [rad/s, rad, N·m]."""
    ungated: Array
    """(K, N, n) other waveforms in the control steps in which a controller computes [N·m]."""
    gated: bool
    fade: Array
    """(N, n) 1/v_gate [s/rad]."""
    offset: Array
    """(N, n) [N·m]."""
    torque: Array
    """(N, n) of the last cycle, written [N·m]."""


class Sampling(NamedTuple):
    """What is recorded while arms follow for K control steps, before they move; all is written.

    A sample has ``stride`` control steps, the first of which is a multiple of it: S samples.
    """

    stride: int
    position: Array
    """(K, N, 3) of the tool points [m]."""
    quaternion: Array
    """(K, N, 4) of the hands."""
    reference: Array
    """(S, N, 7) position [m] and quaternion of the reference in each sample's first step."""
    detailed: bool
    """Whether the next three are recorded too; they start at 0."""
    power: Array
    """(S, N) sum over steps and joints of |dither torque · motor speed| [W]."""
    rate: Array
    """(S, N, n) largest change of torque [N·m/s]."""
    flags: Bools
    """(S, N, 3) whether the controller raised each flag of `impedance.Flags`."""
    previous: Array
    """(N, n) torque on the joints in the step before, kept from call to call [N·m]."""


class Arms(NamedTuple):
    """All that a control step of N arms of n joints reads and writes."""

    step: Index
    """(N,) control steps since the arm began to follow."""
    hold: int
    """Control steps of a controller's cycle."""
    model_period: int
    goal_period: int
    """Control steps between two renewals of the controller's model, and between two looks at the
    goals."""
    plant: PlantArrays
    hand: Hand
    """The true end effector."""
    senses: bool
    """Whether controllers have measured states, and commands take time: else the true states."""
    measured: Measured
    """What controllers have: q, dq; without senses these two only."""
    sent: Sent
    chain: Chain
    measured_hand: Hand
    """The end effector at the measured angles."""
    position: Array
    quaternion: Array
    jacobian: Array
    """(N, 3), (N, 4), (N, 6, n) end effector as controllers have it."""
    movement: Movement
    goals: Goals
    impedance: Impedance
    compensated: bool
    """Whether any arm has a compensation."""
    compensation: Compensations
    added: Array
    """(N, n) dither and compensation of the last cycle, written [N·m]."""
    path: Path
    applied: Array
    """(N, n) what the joints get of the command, written [N·m]."""
    shaking: Shaking
    sampling: Sampling


@compiled
def follow(
    first: int, end: int, row: int, steps: int, arms: Arms, model: ModelArrays, loop: Loop
) -> None:
    """Let some arms follow their paths, between two changes of the slow part of their friction.

    Args:
        first: the first arm.
        end: the arm behind the last.
        row: number of the first control step in what is recorded.
        steps: control steps.
        arms: all arms.
        model: the controllers' model, of these arms alone.
        loop: the physics of these arms.
    """
    plant, sampling = arms.plant, arms.sampling
    for i in range(first, end):
        if not loop.going[i]:
            continue
        if not plant.asymmetric:
            take_fields(i, loop)
        for k in range(row, row + steps):
            if plant.asymmetric:
                write_direction(i, plant)
                take_fields(i, loop)
            due = arms.step[i] % arms.hold == 0
            if arms.senses:
                _sense(i, due, arms.step[i], plant, arms.measured)
            read_hand(i, arms.hand)
            if due:
                _compute(i, k, arms, model)
            command = arms.impedance.command[i]
            if arms.senses:
                send_arm(due, i, arms.step[i], command, arms.sent)
                command = arms.sent.arrived[i]
            pass_torque(i, command, arms.path, arms.applied[i])
            for j in range(len(plant.motor)):
                plant.state[i, plant.torque + j] = arms.applied[i, j] + model.missing[i, j]
            _record(i, k, arms.hand, arms.impedance, sampling)
            if sampling.detailed:
                _record_details(i, k, arms, sampling)
            advance(i, plant.substeps, loop)
            arms.step[i] += 1


@compiled
def _sense(i: int, due: bool, step: int, plant: PlantArrays, measured: Measured) -> None:
    """Let the sensors of arm ``i`` note its state, and where ``due`` read them."""
    n = len(plant.motor)
    q, dq, torque = np.empty(n), np.empty(n), np.empty(n)
    write_links(i, plant.qpos, plant, q)
    write_links(i, plant.qvel, plant, dq)
    write_joint_torque(i, plant, torque)
    sense_arm(due, i, step, q, dq, torque, measured)


@compiled
def _compute(i: int, k: int, a: Arms, model: ModelArrays) -> None:
    """Do a controller's cycle of arm ``i`` in control step ``k``."""
    step, q, dq = a.step[i], a.measured.q, a.measured.dq
    if a.senses:
        follow_chain(i, a.chain, a.measured_hand)
        read_hand(i, a.measured_hand)
    else:
        write_links(i, a.plant.qpos, a.plant, q[i])
        write_links(i, a.plant.qvel, a.plant, dq[i])
    # a cycle takes what fell due since the last
    if step % a.model_period < a.hold:
        renew_dynamics(i, q, model)
        renew_space(i, a.jacobian[i], model.mass[i], a.impedance)
        if a.compensation.reads_model[i]:
            torques = a.compensation.gravity, a.compensation.coriolis
            renew_torques(i, q, dq, model.believed, torques[0], torques[1])
    looks = step % a.goal_period < a.hold
    if looks:
        _look_at_goals(i, step * CONTROL_DT, a)
    if looks or a.impedance.filter_step < 1.0:
        advance_reference(i, a.impedance)
    _shake(i, k, step * CONTROL_DT, dq, a.shaking)
    added = a.shaking.torque
    if a.compensated:
        pose = a.position, a.quaternion, a.jacobian
        compensate(i, pose[0], pose[1], pose[2], dq, model.mass, a.impedance, a.compensation)
        added = a.added
        for j in range(added.shape[1]):
            added[i, j] = a.shaking.torque[i, j] + a.compensation.torque[i, j]
    impedance_cycle(i, a.position, a.quaternion, a.jacobian, q, dq, added, a.impedance)


@compiled
def _look_at_goals(i: int, time: float, a: Arms) -> None:
    """Renew the reference of arm ``i`` at a time since it began to follow [s]."""
    accept(i, a.position[i], a.quaternion[i], time, a.goals, a.movement)
    clock, velocity = time - a.goals.begun[i], np.empty(3)
    target = a.impedance.position_target[i], a.impedance.quaternion_target[i]
    write_sample(i, clock, a.movement, target[0], target[1], velocity)
    if a.compensation.feeds[i]:
        twist = np.empty(6)
        write_twist(i, clock, a.movement, twist)
        look_ahead(i, a.jacobian[i], twist, a.compensation)


@compiled
def _shake(i: int, k: int, time: float, dq: Array, a: Shaking) -> None:
    """Write the dither of arm ``i`` in control step ``k``, at speeds dq (N, n) [rad/s]."""
    for j in range(dq.shape[1]):
        if a.only_sines:
            torque = 0.0
            if a.amplitude[i, j] > 0.0:
                torque = np.sin(a.omega[i, j] * time + a.phase[i, j]) * a.amplitude[i, j]
            a.torque[i, j] = torque
            continue
        torque = a.ungated[k, i, j]
        if a.gated:
            gate = dq[i, j] * a.fade[i, j]
            torque *= np.exp(-(gate * gate))
        a.torque[i, j] = torque + a.offset[i, j]


@compiled
def _record(i: int, k: int, hand: Hand, impedance: Impedance, sampling: Sampling) -> None:
    """Record the pose of arm ``i`` in control step ``k``, and where a sample begins its reference."""
    for m in range(3):
        sampling.position[k, i, m] = hand.position[i, m]
    for m in range(4):
        sampling.quaternion[k, i, m] = hand.quaternion[i, m]
    if k % sampling.stride == 0:
        now = sampling.reference[k // sampling.stride, i]
        now[:3], now[3:] = impedance.position[i], impedance.quaternion[i]


@compiled
def _record_details(i: int, k: int, a: Arms, sampling: Sampling) -> None:
    """Record dither power, change of torque and flags of arm ``i`` in control step ``k``."""
    s, plant, power = k // sampling.stride, a.plant, 0.0
    for j in range(len(plant.motor)):
        power += abs(a.shaking.torque[i, j] * plant.state[i, plant.qvel + plant.motor[j]])
        change = abs(a.applied[i, j] - sampling.previous[i, j])
        sampling.rate[s, i, j] = max(sampling.rate[s, i, j], change / CONTROL_DT)
        sampling.previous[i, j] = a.applied[i, j]
    sampling.power[s, i] += power
    read_flags(i, a.impedance, sampling.flags[s, i])
