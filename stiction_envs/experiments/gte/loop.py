"""The loop of the Generated Trajectory Experiment, in compiled code: control law and physics.

    sense -> pose -> model, goals (in some cycles) -> dither, compensation, impedance -> torque path
    -> physics

Arms are independent of each other, so each takes all control steps of a block before the next: its
state stays in the processor's cache.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.compensation import Compensations, compensate, look_ahead
from stiction_envs.control.impedance import Impedance, impedance_cycle, read_flags, renew_space
from stiction_envs.control.kinematics import Hand, MeasuredHand, read_hand, read_measured
from stiction_envs.control.rotation import write_one_error_matrix
from stiction_envs.control.sensing_kernels import Measured, Sent, send_arm, sense_arm
from stiction_envs.control.torque_path import PathState, pass_torque
from stiction_envs.control.trapezoid import Goals, Movement, accept, write_sample, write_twist
from stiction_envs.friction.model import StickingModel
from stiction_envs.plant import CONTROL_DT
from stiction_envs.plant.loop_arrays import (
    SLOW_STEPS,
    PlantArrays,
    write_direction,
    write_links,
    write_slow,
)
from stiction_envs.plant.loop_batch import Loop, advance, fwd_position, fwd_velocity, take_fields
from stiction_envs.robots import Arm


class Dynamics(NamedTuple):
    """One arm's model and data, in which the dynamics of all arms are computed in turn."""

    model: int
    data: int  # Their addresses
    qpos: Array  # (n,) of the data [rad]
    qvel: Array  # (n,) [rad/s]
    bias: Array  # (n,) torque of gravity, and of speeds [N·m]


class ModelArrays(NamedTuple):
    """Arrays that `renew_dynamics` reads and writes."""

    believed: Dynamics  # Dynamics that the controller has
    true: Dynamics  # Dynamics of the plant
    is_wrong: bool  # Whether the two differ
    entries: Array  # (E,) entries of the sparse inertia that is believed [kg·m²]
    rows: Index
    columns: Index  # (E,) where the entries are
    rotor: Array  # (n,) [kg·m²]
    mass: Array
    missing: Array  # As of `ControllerModel`, written


class ControllerModel:
    """The controller's model of the arm's dynamics, rotors included.

    If this model is not the plant's (payload, tilt), the robot compensates the wrong gravity, and
    the difference acts on the arm.
    """

    def __init__(self, arm: Arm, sticking: StickingModel, nsim: int) -> None:
        """Model ``nsim`` arms: ``arm`` is the controller's, ``sticking`` the plant's."""
        self.is_wrong = arm.xml != sticking.arm.xml
        """Whether it is not the plant's, so that `missing` has to be kept up to date."""
        self._models = [arm.bare_model()]
        if self.is_wrong:
            self._models.append(sticking.arm.bare_model())
        self._rotor = sticking.parameters.rotor_inertia
        n = self._models[0].nv
        self.mass = np.zeros((nsim, n, n))  # (N, n, n) joint-space inertia, rotors included [kg·m²]
        self.missing = np.zeros((nsim, n))
        """(N, n) torque that acts on the joints because gravity is compensated wrongly [N·m]."""
        self._made: list[tuple[ModelArrays, list[mujoco.MjData]]] = []

    def __getstate__(self) -> dict[str, object]:
        """Leave out the arrays with addresses of this process; `arrays` makes new ones."""
        return vars(self) | {"_made": []}

    def arrays(self, part: int = 0) -> ModelArrays:
        """Return the arrays of `renew_dynamics`; each part of the arms has separate data."""
        while len(self._made) <= part:
            # one MjData for all arms stays in the cache: every update computes everything again
            data = [mujoco.MjData(model) for model in self._models]
            dynamics = [
                Dynamics(model._address, d._address, d.qpos, d.qvel, d.qfrc_bias)
                for model, d in zip(self._models, data, strict=True)
            ]
            # where the entries of MuJoCo's sparse inertia are
            model = self._models[0]
            rows = np.repeat(np.arange(model.nv), np.asarray(model.M_rownnz))
            columns = np.asarray(model.M_colind)[: len(rows)].astype(np.int64)
            arrays = ModelArrays(
                *(dynamics[0], dynamics[-1], self.is_wrong, data[0].M),
                *(rows, columns),
                *(self._rotor, self.mass, self.missing),
            )
            self._made.append((arrays, data))  # compiled code has addresses only
        return self._made[part][0]


@inlined
def renew_dynamics(i: int, q: Array, a: ModelArrays) -> None:
    """Write inertia, and the gravity that is compensated wrongly, of arm ``i`` at angles q (N, n).

    An arm whose angles are not finite, which the plant reports, keeps its last.
    """
    believed, true = a.believed, a.true
    total = 0.0
    for j in range(q.shape[1]):
        believed.qpos[j] = true.qpos[j] = q[i, j]
        total += q[i, j]
    if not np.isfinite(total):
        return
    fwd_position(believed.model, believed.data)
    for k in range(len(a.rows)):
        row, column = a.rows[k], a.columns[k]
        a.mass[i, row, column] = a.mass[i, column, row] = a.entries[k]
    for j in range(q.shape[1]):
        a.mass[i, j, j] += a.rotor[j]
    if a.is_wrong:
        fwd_velocity(believed.model, believed.data)
        fwd_position(true.model, true.data)
        fwd_velocity(true.model, true.data)
        for j in range(q.shape[1]):
            a.missing[i, j] = believed.bias[j] - true.bias[j]


@compiled
def renew_torques(
    i: int, q: Array, dq: Array, a: Dynamics, gravity: Array, coriolis: Array
) -> None:
    """Write torques (N, n) [N·m] of gravity, and of Coriolis and centrifugal forces, of arm ``i``.

    Angles q are (N, n) [rad], speeds dq (N, n) [rad/s].
    """
    for j in range(q.shape[1]):
        a.qpos[j] = q[i, j]
    fwd_position(a.model, a.data)
    fwd_velocity(a.model, a.data)
    for j in range(q.shape[1]):
        gravity[i, j], a.qvel[j] = a.bias[j], dq[i, j]
    fwd_velocity(a.model, a.data)
    for j in range(q.shape[1]):
        coriolis[i, j], a.qvel[j] = a.bias[j] - gravity[i, j], 0.0


class Shaking(NamedTuple):
    """The dither of N arms while they follow for K control steps."""

    only_sines: bool  # Whether dither is ungated sines without offset; else `ungated` has it
    omega: Array  # (N, n) of the sines [rad/s]
    phase: Array  # (N, n) of the sines [rad]
    amplitude: Array  # (N, n) of the sines [N·m]
    ungated: Array  # (K, N, n) waveforms in the control steps in which a controller computes [N·m]
    gated: bool
    fade: Array  # (N, n) 1/v_gate [s/rad]
    offset: Array  # (N, n) [N·m]
    torque: Array  # (N, n) of the last cycle, written [N·m]


class Sampling(NamedTuple):
    """Records of K control steps, each made before the arm moves; all arrays are written.

    Each of the S samples has ``stride`` control steps and begins at a multiple of ``stride``.
    """

    stride: int
    position: Array  # (K, N, 3) of the tool points [m]
    quaternion: Array  # (K, N, 4) of the hands
    reference: Array  # (S, N, 7) position [m], quaternion of the reference in a sample's first step
    detailed: bool  # Whether the next three are recorded too; they start at 0
    power: Array  # (S, N) sum over steps and joints of |dither torque · motor speed| [W]
    rate: Array  # (S, N, n) largest change of torque [N·m/s]
    flags: Bools  # (S, N, 3) whether the controller raised each flag of `impedance.read_flags`
    previous: Array  # (N, n) torque on the joints in the step before, kept from call to call [N·m]


class Arms(NamedTuple):
    """All that a control step of N arms of n joints reads and writes."""

    step: Index  # (N,) control steps since the arm began to follow
    hold: int  # Control steps of a controller's cycle
    model_period: int  # Control steps between two renewals of the controller's model
    goal_period: int  # Control steps between two looks at the goals
    plant: PlantArrays
    hand: Hand  # The true end effector
    senses: bool  # Whether controllers have measured states, and commands take time
    measured: Measured  # What controllers have: q, dq; without senses these two only
    sent: Sent
    position: Array  # (N, 3) of the end effector as controllers have it [m]
    quaternion: Array  # (N, 4) of the same
    jacobian: Array  # (N, 6, n) of the same
    movement: Movement
    goals: Goals
    impedance: Impedance
    compensation: Compensations
    added: Array  # (N, n) dither and compensation of the last cycle, written [N·m]
    path: PathState
    applied: Array  # (N, n) what the joints get of the command, written [N·m]


@compiled
def follow(
    first: int,
    end: int,
    steps: int,
    arms: Arms,
    shaking: Shaking,
    sampling: Sampling,
    model: ModelArrays,
    seen: MeasuredHand,
    loop: Loop,
) -> None:
    """Let some arms follow their paths.

    Args:
        first: the first arm.
        end: the arm behind the last.
        steps: control steps.
        arms: all arms.
        shaking: their dither.
        sampling: what is recorded of them.
        model: the controllers' model, of these arms alone.
        seen: the end effector at the measured angles, likewise.
        loop: the physics of these arms.
    """
    # unpacked here: where a structure is taken apart or handed on, each of its arrays costs time
    plant, hand, measured, sent = arms.plant, arms.hand, arms.measured, arms.sent
    impedance, compensation, path = arms.impedance, arms.compensation, arms.path
    movement, goals, step = arms.movement, arms.goals, arms.step
    position, quaternion, jacobian = arms.position, arms.quaternion, arms.jacobian
    q, dq, missing, mass = measured.q, measured.dq, model.missing, model.mass
    applied, added, torque = arms.applied, arms.added, shaking.torque
    command, arrived, state = impedance.command, sent.arrived, plant.state
    stride, law = sampling.stride, compensation.law
    positions, quaternions, references = sampling[1], sampling[2], sampling[3]
    senses, detailed = arms.senses, sampling.detailed
    hold, model_period, goal_period = arms.hold, arms.model_period, arms.goal_period
    age, asymmetric, n = plant.steps, plant.asymmetric[0], q.shape[1]
    feeds, reads_model = compensation.feeds, compensation.reads_model
    substeps, going = plant.substeps, loop.going
    for i in range(first, end):
        if not going[i]:
            continue
        take_fields(i, loop)
        for k in range(steps):
            due, slow = step[i] % hold == 0, age[i] % SLOW_STEPS == 0
            if slow:
                write_slow(i, plant)
            if asymmetric:
                write_direction(i, plant)
            if slow or asymmetric:
                take_fields(i, loop)
            if senses:
                link_q, link_dq = _true_state(i, plant)
                sense_arm(due, i, step[i], link_q, link_dq, measured)
            read_hand(i, i, hand)
            if due and senses:
                read_measured(i, seen)
            elif due:
                write_links(i, plant.qpos, plant, q[i])
                write_links(i, plant.qvel, plant, dq[i])
            if due:
                # a cycle takes what fell due since the last
                if step[i] % model_period < hold:
                    renew_dynamics(i, q, model)
                    renew_space(i, jacobian[i], mass[i], impedance)
                    if reads_model[i]:
                        gravity, coriolis = compensation.gravity, compensation.coriolis
                        renew_torques(i, q, dq, model.believed, gravity, coriolis)
                time = step[i] * CONTROL_DT
                if step[i] % goal_period < hold:
                    accept(i, position[i], quaternion[i], time, goals, movement)
                    clock = time - goals.begun[i]
                    write_sample(i, clock, movement, impedance.position[i], impedance.quaternion[i])
                    write_one_error_matrix(impedance.quaternion[i], impedance.error_matrix[i])
                    if feeds[i]:
                        _feed(i, clock, jacobian[i], movement, compensation)
                _shake(i, k, time, dq, shaking)
                shaken = torque
                if law[i] != 0:
                    pose = position, quaternion, jacobian
                    compensate(i, *pose, dq, mass, impedance, compensation)
                    for j in range(n):
                        added[i, j] = torque[i, j] + compensation.torque[i, j]
                    shaken = added
                impedance_cycle(i, position, quaternion, jacobian, q, dq, shaken, impedance)
            if senses:
                send_arm(due, i, step[i], command[i], sent)
                pass_torque(i, arrived, path, applied)
            else:
                pass_torque(i, command, path, applied)
            for j in range(n):
                state[i, plant.torque + j] = applied[i, j] + missing[i, j]
            for m in range(3):
                positions[k, i, m] = hand.position[i, m]
            for m in range(4):
                quaternions[k, i, m] = hand.quaternion[i, m]
            if k % stride == 0:
                for m in range(3):
                    references[k // stride, i, m] = impedance.position[i, m]
                for m in range(4):
                    references[k // stride, i, 3 + m] = impedance.quaternion[i, m]
            if detailed:
                _record_details(i, k // stride, torque, applied, plant, impedance, sampling)
            advance(i, substeps, loop)
            step[i] += 1
            age[i] += 1


@compiled
def _true_state(i: int, plant: PlantArrays) -> tuple[Array, Array]:
    """Return link angles [rad] and speeds [rad/s] (n,) of arm ``i``."""
    n = len(plant.motor)
    q, dq = np.empty(n), np.empty(n)
    write_links(i, plant.qpos, plant, q)
    write_links(i, plant.qvel, plant, dq)
    return q, dq


@compiled
def _feed(i: int, clock: float, jacobian: Array, movement: Movement, a: Compensations) -> None:
    """Renew q̇_d of arm ``i`` a time ``clock`` [s] after its movement began."""
    twist = np.empty(6)
    write_twist(i, clock, movement, twist)
    look_ahead(i, jacobian, twist, a)


@inlined
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
def _record_details(
    i: int,
    s: int,
    torque: Array,
    applied: Array,
    plant: PlantArrays,
    impedance: Impedance,
    a: Sampling,
) -> None:
    """Record dither power, change of torque and flags of arm ``i`` in sample ``s``."""
    power = 0.0
    for j in range(applied.shape[1]):
        power += abs(torque[i, j] * plant.state[i, plant.qvel + plant.motor[j]])
        change = abs(applied[i, j] - a.previous[i, j])
        a.rate[s, i, j] = max(a.rate[s, i, j], change / CONTROL_DT)
        a.previous[i, j] = applied[i, j]
    a.power[s, i] += power
    read_flags(i, impedance, a.flags[s, i])
