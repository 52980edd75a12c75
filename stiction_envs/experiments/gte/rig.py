"""The Generated Trajectory Experiment as a machine: N arms under Cartesian impedance control.

    approach (servos bring the arm to the start) -> follow (the controller follows goal after goal)

The two are separate calls, so that some simulations can be brought back while others wait.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.compensation import Compensator, compensate
from stiction_envs.control.impedance import CartesianImpedance
from stiction_envs.control.kernels import impedance_cycle, pass_torque, site_kinematics
from stiction_envs.control.kinematics import EndEffector, MeasuredEndEffector
from stiction_envs.control.sensing import CommandLine, Senses, Sensing
from stiction_envs.control.sensing_kernels import send
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.trajectory import GoalSequencer, MotionLimits, Path
from stiction_envs.dither.kernels import sine
from stiction_envs.experiments.base import Experiment
from stiction_envs.experiments.gte.controller_model import ControllerModel
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.rig import Rig, minimum_jerk
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.model import link_angles
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    line: tuple[Any, ...]
    """The last of `sensing_kernels.send`; what arrives is its last."""


class DitherArrays(NamedTuple):
    """The dither, as far as it is sines."""

    only_sines: bool
    """Any other dither is in `torque` already."""
    omega: Array
    phase: Array
    amplitude: Array
    """As in `dither.kernels.sine`."""
    torque: Array
    """(N, n) sines are written in every controller cycle [N·m]."""


class CompensationArrays(NamedTuple):
    """Compensation of the joints' friction."""

    active: bool
    """Whether any arm is compensated."""
    arguments: tuple[Any, ...]
    """The last of `compensate`, its result at the end."""
    added: Array
    """(N, n) dither and compensation together, written where active [N·m]."""


class StepArrays(NamedTuple):
    """All that a control step reads and writes; the same objects while arms follow."""

    site: tuple[Any, ...]
    """Of `site_kinematics`; it writes the last three: position, quaternion, Jacobian."""
    joints: tuple[Any, ...]
    """`JointArrays`."""
    seen: tuple[Any, ...]
    """`SeenArrays`."""
    step: Index
    """(N,) control steps since the arm began to follow."""
    dither: tuple[Any, ...]
    """`DitherArrays`."""
    compensation: tuple[Any, ...]
    """`CompensationArrays`."""
    impedance: tuple[Any, ...]
    """Of `impedance_cycle` behind the dither; the last is the command that it writes."""
    path: tuple[Array, float, Array, Array, Array]
    """Of `pass_torque` between command and result."""
    missing: Array
    """(N, n) torque that acts besides, gravity compensated wrongly [N·m]."""
    applied: Array
    """(N, n) what the joints get of the command, written [N·m]."""
    torque: Array
    """(N, n) the sum of that and `missing`, written [N·m]."""


@compiled
def control_step(due: bool, arrays: tuple[Any, ...]) -> None:
    """Read the end effector and, where ``due``, compute the next command; pass the command on.

    One call of compiled code: called one by one from Python, these functions would spend half of
    the time between their calls. Where not ``due``, the controller's command is held.

    Args:
        due: whether the controller computes in this step.
        arrays: `StepArrays` and those within as plain tuples, which numba takes over faster.
    """
    a = StepArrays(*arrays)
    site_kinematics(*a.site)
    seen = SeenArrays(*a.seen)
    if due:
        joints, dither, impedance = JointArrays(*a.joints), DitherArrays(*a.dither), a.impedance
        if seen.active:
            position, quaternion, jacobian = seen.pose
            q, dq = seen.q, seen.dq
        else:
            position, quaternion, jacobian = a.site[-3], a.site[-2], a.site[-1]
            q = link_angles(joints.qpos, joints.motor, joints.spring)
            dq = link_angles(joints.qvel, joints.motor, joints.spring)
        compensation = CompensationArrays(*a.compensation)
        if dither.only_sines:
            time = a.step.astype(np.float64) * CONTROL_DT
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
    command = a.impedance[-1]
    if seen.active:
        send(due, a.step, command, seen.line)
        command = seen.line[-1]
    pass_torque(command, *a.path, a.applied)
    for i in range(a.torque.shape[0]):
        for j in range(a.torque.shape[1]):
            a.torque[i, j] = a.applied[i, j] + a.missing[i, j]


@dataclass(frozen=True, init=False, repr=False)
class GTESetup(Experiment):
    """What an experiment on paths is made of."""

    protocol: GTEProtocol
    approach: Protocol
    settings: ImpedanceSettings
    motion: MotionLimits
    start: Array
    """(n,) joint angles at the start [rad]."""
    tool: Array
    """(3,) the point that is controlled and measured, from the flange in the hand's frame [m]."""
    controller_model: Arm | None


class GTERig(Rig):
    """N arms that follow paths."""

    def __init__(
        self,
        setup: GTESetup,
        nsim: int,
        capacity: int,
        parameters: FrictionParameters | None = None,
    ) -> None:
        """Make the rig; every arm has to `begin`.

        Args:
            setup: the experiment.
            nsim: number of arms.
            capacity: most goals of a path.
            parameters: friction of one arm or of each simulation, None for the model's.
        """
        super().__init__(
            setup, nsim, approach=setup.approach, parameters=parameters, closed_loop=True
        )
        sticking, arm, settings, motion = (
            setup.sticking,
            setup.sticking.arm,
            setup.settings,
            setup.motion,
        )
        self.protocol, self.motion, self.start = setup.protocol, motion, np.array(setup.start)
        self.end_effector = EndEffector(sticking, self.plant.batch, setup.tool)
        self.seen_end_effector = self.end_effector
        """What the controllers have of it."""
        if self.senses is not None:
            seen = MeasuredEndEffector(sticking, self.senses.q, setup.tool)
            self.seen_end_effector = seen
        self._model = ControllerModel(setup.controller_model or arm, sticking, nsim, setup.threads)
        self.controller = CartesianImpedance(settings, nsim, arm.limits)
        self.compensator = Compensator(
            *(nsim, self.n),
            damping=settings.pseudoinverse_damping,
            command=self.controller.command,
            mass=self._model.mass,
            period=self.interface.hold_steps * CONTROL_DT,
        )
        self.sequencer = GoalSequencer(nsim, motion, capacity)
        self._inertia = self._servos.inertia(self.start[None])
        self._goal_period = round(1.0 / (motion.publish_rate_hz * CONTROL_DT))
        self._model_period = setup.protocol.model_steps
        self.start_position, self.start_quaternion = self._nominal()
        self._watch: Callable[[], None] | None = None
        self._count, self._hold_steps = 0, self.interface.hold_steps
        self._arrays: tuple[Any, ...] = ()
        self._nothing, self._added = np.zeros((2, nsim, self.n))
        self.applied = np.zeros((nsim, self.n))
        """(N, n) torque on the joints in the last control step, overwritten [N·m]."""
        self._torque = np.zeros((nsim, self.n))
        # compiled code takes arrays that it does not use as well
        nothing = Sensing.ideal()
        self._no_senses = Senses(nothing, 0, self.n), CommandLine(nothing, 0, self.n)
        self.dither_torque = np.zeros((nsim, self.n))
        """(N, n) dither torque of the last controller cycle, overwritten by the next [N·m]."""

    def _nominal(self) -> tuple[Array, Array]:
        """Return the pose of tool point and hand, (3,), (4,), at the start angles."""
        self.plant.reset(np.arange(self.nsim), np.broadcast_to(self.start, (self.nsim, self.n)))
        self.end_effector.read()
        return self.end_effector.position[0].copy(), self.end_effector.quaternion[0].copy()

    def begin(
        self, ids: Index, paths: Sequence[Path], stiffness: Array, keys: Sequence[tuple[int, ...]]
    ) -> None:
        """Bring arms to the start, against their friction, and give them their goals.

        Args:
            ids: (M,) sorted simulations.
            paths: of each, with no more goals than the capacity.
            stiffness: (M, 3) translational, rotational, nullspace.
            keys: seed the scatter of each.
        """
        p, m = self.approach_protocol, len(ids)
        target = np.tile(self.start, (m, 1))
        origin = target.copy()
        factor = np.ones((m, self.n))
        self.dither_phase[ids], self.dither_seed[ids] = 0.0, 0
        self._seed_senses(ids, keys)
        for row, (i, key) in enumerate(zip(ids, keys, strict=True)):
            rng = np.random.default_rng([self.seed, *key])
            # the arm comes back from where the path was: from any side
            side = rng.choice([-1.0, 1.0], size=self.n) if self.scatter else 1.0
            origin[row] += self.protocol.return_distance * side
            if self.scatter:
                shift, factor[row] = self._draw_pose_and_friction(rng)
                target[row] += shift
                self._draw_dither(i, rng)
        low, high = self.plant.sticking.arm.limits.position.T
        self.plant.reset(ids, np.clip(origin, low, high))
        self.plant.scale_friction(ids, factor)
        here = (np.repeat(x, m, axis=0) for x in self._inertia)
        self.plant.set_servo(ids, *self._servos_of(ids, *here), origin)
        steps = round((p.return_time + p.settle_time) / CONTROL_DT)
        x = minimum_jerk(np.arange(steps) * CONTROL_DT / p.return_time)
        moves = origin[:, None] + x[:, None] * (target - origin)[:, None]
        self.plant.run(np.zeros((m, steps, self.n)), ids, setpoint=moves)
        zero = np.zeros((m, self.n))
        self.plant.set_servo(ids, zero, zero, target)
        self.plant.refresh(ids)
        self._hand_over(ids, paths, stiffness)

    def _hand_over(self, ids: Index, paths: Sequence[Path], stiffness: Array) -> None:
        """Let the controller take over the arms where they are."""
        self._rest_senses(ids)
        self.end_effector.read()
        pose = self.seen_end_effector
        pose.read()
        x, quaternion, q = pose.position[ids], pose.quaternion[ids], self.seen_position
        self.controller.set_stiffness(
            ids,
            translational=stiffness[:, 0],
            rotational=stiffness[:, 1],
            nullspace=stiffness[:, 2],
        )
        self.controller.reset(ids, x, quaternion, q[ids])
        self._model.update(q)
        self.controller.update_model(ids, pose.jacobian[ids], self._model.mass[ids])
        self._path.reset(ids)
        self.compensator.reset(ids)
        self.step[ids], self.dither_torque[ids] = 0, 0.0
        for row, i in enumerate(ids):
            here = np.array([i])
            goals, turns = paths[row].goals(self.start_position[None], self.start_quaternion[None])
            self.sequencer.start(
                *(here, goals, turns, x[row : row + 1], quaternion[row : row + 1], 0.0),
                paths[row].pace,
            )

    @property
    def undithered_torque(self) -> Array:
        """(N, n) torque that controller and compensation asked for in the last cycle, before the
        limits and without dither; 0 before the first [N·m]."""
        wanted, after = self.controller.wanted, self.controller.settings.dither_after_saturation
        return wanted.copy() if after else wanted - self.dither_torque

    def advance(self, steps: int, watch: Callable[[], None] | None = None) -> None:
        """Follow for ``steps`` control steps; ``watch`` is called in each, before the arms move."""
        self._watch, self._count = watch, int(self.step.max())
        self._arrays = self._step_arrays()
        self.plant.follow(self._law, steps)

    def _law(self) -> Array:
        step, hold = self._count, self._hold_steps
        self._count = step + 1
        due = step % hold == 0
        if self.senses is not None:
            plant = self.plant
            state = plant.position, plant.velocity, plant.joint_torque
            self.senses.read(due, self.step, *state)
        # a slow controller takes at its next cycle what fell due since its last
        model, goals = step % self._model_period < hold, step % self._goal_period < hold
        if due and (model or goals):
            self._look_ahead(model, goals)
        self._control_step(due)
        if self._watch is not None:
            self._watch()
        self.step += 1
        return self._torque

    def _look_ahead(self, model: bool, goals: bool) -> None:
        """Update the controller's model of the arm and its reference, where due."""
        pose, t = self.seen_end_effector, self._command_time()
        pose.read()
        if model:
            self._model.update(self.seen_position)
            self.controller.update_model(None, pose.jacobian, self._model.mass)
            if self.compensator.reads_model:
                wanted = (self.compensator.gravity, self.compensator.coriolis)
                self._model.torques(self.seen_position, self.seen_velocity, *wanted)
        if goals:
            self.sequencer.accept(pose.position, pose.quaternion, t)
            position, quaternion, _, _ = self.sequencer.reference(t)
            self.controller.set_reference(position, quaternion)
            if self.compensator.feeds:
                self.compensator.look_ahead(pose.jacobian, self.sequencer.twist(t))

    def _control_step(self, due: bool) -> None:
        if due:
            if self.senses is not None:
                self.seen_end_effector.read()
            self.controller.advance_filter()
            if self.dither.sines is None:
                self.dither_torque[:] = self.dither.torque(self._command_time(), self._gate_speed())
        control_step(due, self._arrays)

    def _step_arrays(self) -> tuple[Any, ...]:
        """Return what `control_step` works on until the arms stop following."""
        sticking, model, dither = self.plant.sticking, self._model, self.dither
        sines = dither.sines or (self._nothing, self._nothing, dither.amplitude)
        joints = JointArrays(*self.plant.state, sticking.motor, sticking.spring)
        shaking = DitherArrays(dither.sines is not None, *sines, self.dither_torque)
        compensator, pose = self.compensator, self.seen_end_effector
        measured, line = self.senses, self._line
        if measured is None or line is None:
            measured, line = self._no_senses
        seen = SeenArrays(
            active=self.senses is not None,
            pose=(pose.position, pose.quaternion, pose.jacobian),
            q=measured.q,
            dq=measured.dq,
            torque=measured.torque,
            line=line.arguments,
        )
        return tuple(
            StepArrays(
                site=self.end_effector.arguments,
                joints=tuple(joints),
                seen=tuple(seen),
                step=self.step,
                dither=tuple(shaking),
                compensation=(compensator.active, compensator.arguments, self._added),
                impedance=self.controller.arguments,
                path=self._path.arguments,
                missing=model.missing,
                applied=self.applied,
                torque=self._torque,
            )
        )
