"""The Generated Trajectory Experiment as a machine: N arms under Cartesian impedance control.

    approach (servos bring the arm to the start) -> follow (the controller follows goal after goal)

The two are separate calls, so that some simulations can be brought back while others wait.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import Arguments
from stiction_envs.control.compensation import Compensator
from stiction_envs.control.impedance import CartesianImpedance
from stiction_envs.control.kinematics import EndEffector, MeasuredEndEffector
from stiction_envs.control.sensing import CommandLine, Senses, Sensing
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.trajectory import GoalSequencer, MotionLimits, Path
from stiction_envs.experiments.base import Experiment
from stiction_envs.experiments.gte.controller_model import ControllerModel
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.gte.step import (
    AheadArrays,
    CompensationArrays,
    DitherArrays,
    JointArrays,
    SeenArrays,
    StepArrays,
    control_step,
    follow_steps,
    is_due,
    look_ahead,
    of_arms,
)
from stiction_envs.experiments.rig import Rig, minimum_jerk
from stiction_envs.experiments.servos import Approach
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, init=False, repr=False)
class GTESetup(Experiment):
    """What an experiment on paths is made of."""

    protocol: GTEProtocol
    approach: Approach
    settings: ImpedanceSettings
    motion: MotionLimits
    start: Array
    """(n,) joint angles at the start [rad]."""
    tool: Array
    """(3,) the point that is controlled and measured, from the flange in the hand's frame [m]."""
    controller_model: Arm | None


class Sampling(NamedTuple):
    """What is noted while arms follow for K control steps, before they move."""

    position: Array
    """(K, N, 3) of the tool points in each step, written [m]."""
    quaternion: Array
    """(K, N, 4) of the hands, written."""
    stride: int
    """Control steps of a sample."""
    reference: Array
    """(S, N, 7) position [m] and quaternion of the reference in each sample's first, written."""


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
        self._model = ControllerModel(setup.controller_model or arm, sticking, nsim)
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
        self._watch: Callable[..., None] = _nothing
        self._count, self._row, self._hold_steps = 0, 0, self.interface.hold_steps
        self._arrays: StepArrays
        self._nothing, self._added = np.zeros((2, nsim, self.n))
        self._accepted = np.zeros(nsim, dtype=bool)
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
        p, m = self.approach_numbers, len(ids)
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

    def advance(
        self,
        steps: int,
        watch: Callable[[], None] | None = None,
        sampling: Sampling | None = None,
    ) -> None:
        """Follow for some control steps.

        Args:
            steps: K control steps.
            watch: called in each, before the arms move; it costs speed.
            sampling: what is noted meanwhile.
        """
        shape = steps, self.nsim
        if sampling is None:
            poses = np.empty((*shape, 3)), np.empty((*shape, 4))
            sampling = Sampling(*poses, steps, np.empty((1, self.nsim, 7)))
        self._watch = watch or _nothing
        self._count, self._row = int(self.step.max()), 0
        arrays = self._step_arrays(sampling)
        self._arrays = arrays
        # what is not compiled is asked in every control step
        python = watch or self.senses or not self.dither.sines or self.controller.filters
        loops = () if python else self.plant.compiled_loops
        if not loops:
            self.plant.follow(self._law, steps)
            return
        parts = [(of_arms(arrays, arms, self._model.of_arms(arms)), loop) for arms, loop in loops]
        self.plant.follow_compiled(partial(self._follow_block, parts), steps)

    def _follow_block(self, parts: Sequence[tuple[StepArrays, Arguments]], steps: int) -> None:
        """Follow for control steps between which friction does not change slowly.

        Of each part of the arms its `StepArrays`, and its loop.
        """
        end, looks = self._row + steps, not self._looks_with_numpy
        while self._row < end:
            count = end - self._row
            if not looks:
                model, goals = self._due(self._count)
                if model or goals:
                    self._look_ahead(model, goals)
                later = range(1, count)
                count = next((k for k in later if any(self._due(self._count + k))), count)
            now = count, self._count, self._row, looks
            self._share([partial(follow_steps, *now, *part) for part in parts])
            self._count, self._row = self._count + count, self._row + count

    @property
    def _looks_with_numpy(self) -> bool:
        """Whether some of what is renewed in a controller's cycle is not compiled."""
        return self.compensator.feeds or self.compensator.reads_model

    def _due(self, step: int) -> tuple[bool, bool]:
        """Return whether model and goals are looked at in a control step."""
        hold = self._hold_steps
        return is_due(step, hold, self._model_period), is_due(step, hold, self._goal_period)

    def _law(self) -> Array:
        step, row = self._count, self._row
        self._count, self._row = step + 1, row + 1
        due = step % self._hold_steps == 0
        if self.senses is not None:
            plant = self.plant
            state = plant.position, plant.velocity, plant.joint_torque
            self.senses.read(due, self.step, *state)
        model, goals = self._due(step)
        if model or goals:
            self._look_ahead(model, goals)
        self._control_step(due, row)
        self._watch()
        self.step += 1
        return self._torque

    def _look_ahead(self, model: bool, goals: bool) -> None:
        """Update the controller's model of the arm and its reference, where due."""
        pose, compensator = self.seen_end_effector, self.compensator
        pose.read()
        a = self._arrays
        tick = self.interface.tick(self.step)
        look_ahead(model, goals, a.site, a.joints, a.seen, tick, a.ahead)
        if model and compensator.reads_model:
            wanted = compensator.gravity, compensator.coriolis
            self._model.torques(self.seen_position, self.seen_velocity, *wanted)
        if goals and compensator.feeds:
            compensator.look_ahead(pose.jacobian, self.sequencer.twist(self._command_time()))

    def _control_step(self, due: bool, row: int) -> None:
        if due:
            if self.senses is not None:
                self.seen_end_effector.read()
            self.controller.advance_filter()
            if self.dither.sines is None:
                self.dither_torque[:] = self.dither.torque(self._command_time(), self._gate_speed())
        control_step(due, row, self._arrays)

    def _step_arrays(self, sampling: Sampling) -> StepArrays:
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
        ahead = AheadArrays(
            model_period=self._model_period,
            goal_period=self._goal_period,
            dynamics=model.arrays,
            space=self.controller.model_arguments,
            goals=self.sequencer.arguments,
            accepted=self._accepted,
            reference=self.controller.reference_arguments,
        )
        return StepArrays(
            site=self.end_effector.arguments,
            joints=joints,
            seen=seen,
            ahead=ahead,
            hold=self._hold_steps,
            step=self.step,
            dither=shaking,
            compensation=CompensationArrays(compensator.active, compensator.arguments, self._added),
            impedance=self.controller.arguments,
            path=self._path.arguments,
            missing=model.missing,
            applied=self.applied,
            torque=self._torque,
            poses=(sampling.position, sampling.quaternion),
            stride=sampling.stride,
            sampled=sampling.reference,
        )


def _nothing(*_: int) -> None:
    """Do nothing in a control step."""
