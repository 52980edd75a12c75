"""The Generated Trajectory Experiment as a machine: N arms under Cartesian impedance control.

    approach (servos bring the arm to the start) -> follow (the controller follows goal after goal)

The two are separate calls, so that some simulations can be brought back while others wait.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.compensation import Compensator
from stiction_envs.control.impedance import CartesianImpedance
from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.control.trajectory import GoalSequencer, MotionLimits, Path
from stiction_envs.experiments.gte.controller_model import ControllerModel
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.gte.step import control_step
from stiction_envs.experiments.rig import Rig, minimum_jerk
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class GTERig(Rig):
    """N arms that follow paths."""

    def __init__(
        self,
        sticking: StickingModel,
        nsim: int,
        *,
        protocol: GTEProtocol,
        approach: Protocol,
        settings: ImpedanceSettings,
        motion: MotionLimits,
        interface: TorqueInterface,
        capacity: int,
        start: Array,
        tool: ArrayLike = (0.0, 0.0, 0.0),
        controller_model: Arm | None = None,
        scatter: bool = True,
        seed: int = 0,
        parameters: FrictionParameters | None = None,
        nthread: int = 0,
    ) -> None:
        """Make the rig; every arm has to `begin`.

        Args:
            sticking: the model.
            nsim: number of arms.
            protocol: numbers of the experiment.
            approach: those of the move to the start, and of the scatter.
            settings: of the controller.
            motion: of the trajectory generator.
            interface: what the robot does to commanded torques.
            capacity: most goals of a path.
            start: (n,) joint angles at the start [rad].
            tool: (3,) the tool point from the flange, in the hand's frame [m].
            controller_model: the controller's own model of the arm, None for the true one.
            scatter: whether iterations differ by pose, friction and dither phase.
            seed: of that scatter.
            parameters: friction of one arm or of each simulation, None for the model's.
            nthread: threads, 0 for all processors.
        """
        super().__init__(
            sticking,
            nsim,
            approach=approach,
            interface=interface,
            scatter=scatter,
            seed=seed,
            parameters=parameters,
            nthread=nthread,
            closed_loop=True,
        )
        self.protocol, self.motion, self.start = protocol, motion, np.array(start)
        self.end_effector = EndEffector(sticking, self.plant.batch, tool)
        arm = sticking.arm
        self._model = ControllerModel(
            controller_model or arm, sticking, nsim, nthread, coriolis=settings.coriolis
        )
        self.controller = CartesianImpedance(settings, nsim, arm.limits)
        self.compensator = Compensator(nsim, self.n, damping=settings.pseudoinverse_damping)
        self.sequencer = GoalSequencer(nsim, motion, capacity)
        self._inertia = self._servos.inertia(self.start[None])
        self._goal_period = round(1.0 / (motion.publish_rate_hz * CONTROL_DT))
        self._model_period = protocol.model_steps
        self.start_position, self.start_quaternion = self._nominal()
        self._watch: Callable[[], None] | None = None
        self._count, self._hold_steps = 0, interface.hold_steps
        self._arguments: tuple[Any, ...] = ()
        self._nothing, self._added = np.zeros((2, nsim, self.n))
        self.applied = np.zeros((nsim, self.n))
        """(N, n) torque on the joints in the last control step, overwritten [N·m]."""
        self._torque = np.zeros((nsim, self.n))
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
        x = minimum_jerk(np.clip(np.arange(steps) * CONTROL_DT / p.return_time, 0.0, 1.0))
        moves = origin[:, None] + x[:, None] * (target - origin)[:, None]
        self.plant.run(np.zeros((m, steps, self.n)), ids, setpoint=moves)
        zero = np.zeros((m, self.n))
        self.plant.set_servo(ids, zero, zero, target)
        self.plant.refresh(ids)
        self._hand_over(ids, paths, stiffness)

    def _hand_over(self, ids: Index, paths: Sequence[Path], stiffness: Array) -> None:
        """Let the controller take over the arms where they are."""
        self.end_effector.read()
        x, quaternion = self.end_effector.position[ids], self.end_effector.quaternion[ids]
        q = self.plant.position
        self.controller.set_stiffness(
            ids,
            translational=stiffness[:, 0],
            rotational=stiffness[:, 1],
            nullspace=stiffness[:, 2],
        )
        # after the stiffness: its filter starts settled
        self.controller.reset(ids, x, quaternion, q[ids])
        self._model.update(q, self.plant.velocity)
        self.controller.update_model(ids, self.end_effector.jacobian[ids], self._model.mass[ids])
        self._path.reset(ids)
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
        self._arguments = self._step_arguments()
        self.plant.follow(self._law, steps)

    def _law(self) -> Array:
        step, hold = self._count, self._hold_steps
        self._count = step + 1
        due = step % hold == 0
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
        """Renew what the controller knows of the arm, and where it is to be."""
        pose, t = self.end_effector, self._command_time()
        pose.read()
        if model:
            self._model.update(self.plant.position, self.plant.velocity)
            self.controller.update_model(None, pose.jacobian, self._model.mass)
        if goals:
            self.sequencer.accept(pose.position, pose.quaternion, t)
            position, quaternion, _, _ = self.sequencer.reference(t)
            self.controller.set_reference(position, quaternion)
            if self.compensator.feeds:
                self.compensator.look_ahead(pose.jacobian, self.sequencer.twist(t))

    def _control_step(self, due: bool) -> None:
        if due:
            self.controller.advance_filters()
            if self.dither.sines is None:
                self.dither_torque[:] = self.dither.torque(self._command_time(), self._gate_speed())
        control_step(due, *self._arguments)

    def _step_arguments(self) -> tuple[Any, ...]:
        """Return those of `control_step` that stay the same objects while arms follow."""
        sticking, model, dither = self.plant.sticking, self._model, self.dither
        sines = dither.sines or (self._nothing, self._nothing, dither.amplitude)
        return (
            self.end_effector.arguments,
            (*self.plant.state, sticking.motor, sticking.spring),
            (dither.sines is not None, *sines),
            self.step,
            (self.compensator.active, self.compensator.arguments, self._added),
            # zero where it is not asked for
            (model.coriolis, self._nothing),
            self.controller.arguments,
            self._path.arguments,
            model.missing,
            self.dither_torque,
            self.applied,
            self._torque,
        )
