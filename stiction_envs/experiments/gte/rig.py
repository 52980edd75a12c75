"""Simulator of the Generated Trajectory Experiment: N arms under impedance control.

    approach (servos bring the arm to the start) -> follow (the controller follows goal after goal)

The two are separate calls, so that some simulations can be brought back while others wait.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.control.compensation import Compensator
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings
from stiction_envs.control.kinematics import EndEffector, MeasuredEndEffector
from stiction_envs.control.sensing import Senses, Sensing
from stiction_envs.control.trajectory import GoalSequencer, MotionLimits, Path
from stiction_envs.experiments.gte.loop import Arms, ControllerModel, Sampling, Shaking, follow
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.holding_servos import Approach
from stiction_envs.experiments.rig import Experiment, Rig, minimum_jerk
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT, raise_if_stopped
from stiction_envs.plant.loop_batch import Threads
from stiction_envs.robots import Arm


@dataclass(frozen=True, init=False, repr=False)
class GTESetup(Experiment):
    """Parts of an experiment on paths."""

    protocol: GTEProtocol
    approach: Approach
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
        """Make the rig of ``nsim`` arms, with ``capacity`` goals at most; every arm has to `begin`.

        ``parameters`` is the friction of one arm or of each; None for the model's.
        """
        super().__init__(
            setup, nsim, approach=setup.approach, parameters=parameters, closed_loop=True
        )
        sticking, settings, motion = setup.sticking, setup.settings, setup.motion
        arm = sticking.arm
        self.protocol, self.motion, self.start = setup.protocol, motion, np.array(setup.start)
        self.end_effector = EndEffector(sticking, self.plant.batch, setup.tool)
        # compiled code takes the arrays of senses also where there are none
        self._measured = self.senses or Senses(Sensing(), nsim, self.n)
        self._measured_end_effector = MeasuredEndEffector(arm, self._measured.q, setup.tool)
        self.seen_end_effector = (
            self.end_effector if self.senses is None else self._measured_end_effector
        )
        """The end effector as the controllers have it."""
        self._model = ControllerModel(setup.controller_model or arm, sticking, nsim)
        self.controller = CartesianImpedance(settings, nsim, arm.limits)
        self.compensator = Compensator(
            *(nsim, self.n),
            damping=settings.pseudoinverse_damping,
            period=self.interface.hold_steps * CONTROL_DT,
        )
        self.sequencer = GoalSequencer(nsim, motion, capacity)
        self._inertia = self._servos.inertia(self.start[None])
        self.plant.reset(np.arange(nsim), np.broadcast_to(self.start, (nsim, self.n)))
        self.end_effector.read()
        self.start_position = self.end_effector.position[0].copy()
        self.start_quaternion = self.end_effector.quaternion[0].copy()
        self.applied, self._added = np.zeros((2, nsim, self.n))
        """(N, n) torque on the joints in the last control step, overwritten [N·m]."""
        self.dither_torque = np.zeros((nsim, self.n))
        """(N, n) dither torque of the last controller cycle, overwritten by the next [N·m]."""
        self._arms = self._make_arms()
        self._threads = Threads(len(self.plant.loop_batch.parts))

    def begin(
        self, ids: Index, paths: Sequence[Path], stiffness: Array, keys: Sequence[tuple[int, ...]]
    ) -> None:
        """Bring arms ``ids`` (M,), sorted, to the start, against their friction; give them goals.

        Paths have at most the capacity's goals; ``stiffness`` (M, 3) is translational, rotational,
        nullspace; ``keys`` seed the scatter of each arm.
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
        self.controller.set_stiffness(ids, *np.hsplit(stiffness, 3))
        self.controller.reset(ids, x, quaternion, q[ids])
        self._path.reset(ids)
        self.compensator.reset(ids)
        self.step[ids], self.dither_torque[ids] = 0, 0.0
        for row, i in enumerate(ids):
            goals, turns = paths[row].goals(self.start_position[None], self.start_quaternion[None])
            here = x[row], quaternion[row]
            self.sequencer.start(int(i), goals[0], turns[0], *here, paths[row].pace)

    @property
    def undithered_torque(self) -> Array:
        """(N, n) torque that controller and compensation asked for in the last cycle, before the
        limits and without dither; 0 before the first [N·m]."""
        return self.controller.wanted - self.dither_torque

    def advance(self, steps: int, sampling: Sampling | None = None) -> None:
        """Follow for some control steps; `sampling` is what is recorded meanwhile."""
        sampling = blank_sampling(steps, steps, self.nsim, self.n) if sampling is None else sampling
        shaking = self._shaking(steps)
        tasks = []
        for k, (first, end, loop) in enumerate(self.plant.loops()):
            own = self._model.arrays(k), self._measured_end_effector.measured(k), loop
            tasks.append(partial(follow, first, end, steps, self._arms, shaking, sampling, *own))
        self._threads.run(tasks)
        raise_if_stopped(self.plant.batch)

    def _make_arms(self) -> Arms:
        pose, motion = self.seen_end_effector, self.motion
        return Arms(
            step=self.step,
            hold=self.interface.hold_steps,
            model_period=self.protocol.model_steps,
            goal_period=round(1.0 / (motion.publish_rate_hz * CONTROL_DT)),
            plant=self.plant.arrays,
            hand=self.end_effector.arrays,
            senses=self.senses is not None,
            measured=self._measured.arrays,
            sent=self._measured.sent,
            position=pose.position,
            quaternion=pose.quaternion,
            jacobian=pose.jacobian,
            movement=self.sequencer.movement,
            goals=self.sequencer.arrays,
            impedance=self.controller.arrays,
            compensation=self.compensator.arrays,
            added=self._added,
            path=self._path.arrays,
            applied=self.applied,
        )

    def _shaking(self, steps: int) -> Shaking:
        dither, zero = self.dither, np.zeros((self.nsim, self.n))
        ungated = np.zeros((0, self.nsim, self.n))
        if dither.sines is None:
            ungated = np.zeros((steps, self.nsim, self.n))
            for k in range(steps):
                if ((self.step + k) % self.interface.hold_steps == 0).any():
                    ungated[k] = dither.ungated(self._command_time(k))
        omega, phase, amplitude = dither.sines or (zero, zero, zero)
        return Shaking(
            only_sines=dither.sines is not None,
            omega=omega,
            phase=phase,
            amplitude=amplitude,
            ungated=ungated,
            gated=dither.gated,
            fade=1.0 / dither.gate_velocity,
            offset=dither.offset,
            torque=self.dither_torque,
        )


def blank_sampling(
    steps: int, stride: int, nsim: int, n: int, *, detailed: bool = False
) -> Sampling:
    """Return empty arrays for K control steps in samples of ``stride``, N arms and n joints."""
    samples = -(-steps // stride)
    return Sampling(
        stride=stride,
        position=np.zeros((steps, nsim, 3)),
        quaternion=np.zeros((steps, nsim, 4)),
        reference=np.zeros((samples, nsim, 7)),
        detailed=detailed,
        power=np.zeros((samples, nsim)),
        rate=np.zeros((samples, nsim, n)),
        flags=np.zeros((samples, nsim, 3), dtype=bool),
        previous=np.zeros((nsim, n)),
    )
