"""The Generated Trajectory Experiment as a machine: N arms under Cartesian impedance control.

    approach (servos bring the arm to the start) -> follow (the controller follows goal after goal)

The two are separate calls, so that some simulations can be brought back while others wait.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.impedance import CartesianImpedance
from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.torque_path import TorqueInterface, TorquePath
from stiction_envs.control.trajectory import GoalKeeper, MotionLimits, Path
from stiction_envs.dither.dither import Dither
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.gte.step import control_step
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.friction.model import StickingModel, link_inertia
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Belief:
    """What the controller believes the arm's dynamics are: its own model, rotors added.

    Where it is not the plant's (payload, tilt), the robot compensates the wrong gravity, and the
    difference acts on the arm.
    """

    def __init__(
        self, arm: Arm, sticking: StickingModel, nsim: int, nthread: int, *, coriolis: bool = True
    ) -> None:
        model = arm.bare_model()
        # few MjData for all arms stay in the cache: every update computes everything anew anyway
        self._batch = Batch(model, nsim, nthread)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._bias, self._mass = self._batch.bind("qfrc_bias"), self._batch.bind("M")
        self._rotor = sticking.parameters.rotor_inertia
        self._coriolis = coriolis
        self._rows, self._columns = _entries(model)
        self._true: Batch | None = None
        if arm.xml != sticking.arm.xml:
            self._true = Batch(sticking.arm.bare_model(), nsim, nthread)
            self._true_qpos = self._true.bind("qpos")
            self._true_bias = self._true.bind("qfrc_bias")
        self.mass = np.zeros((nsim, model.nv, model.nv))
        """(N, n, n) joint-space inertia, rotors included [kg·m²]."""
        self.coriolis = np.zeros((nsim, model.nv))
        """(N, n) C(q, q̇)q̇, if asked for [N·m]."""
        self.missing = np.zeros((nsim, model.nv))
        """(N, n) torque that acts on the joints because gravity is compensated wrongly [N·m]."""

    def update(self, q: Array, dq: Array) -> None:
        """Take the present state (N, n) [rad], (N, n) [rad/s]."""
        self._qpos[:], self._qvel[:] = q, 0.0
        biased = self._coriolis or self._true is not None
        stage = mujoco.mjtStage.mjSTAGE_VEL if biased else mujoco.mjtStage.mjSTAGE_POS
        self._batch.forward(stage=stage)
        _spread(self._mass, self._rows, self._columns, self._rotor, self.mass)
        gravity = self._bias.copy() if biased else self._bias
        if self._coriolis:
            self._qvel[:] = dq
            self._batch.forward(stage=stage)
            np.subtract(self._bias, gravity, out=self.coriolis)
        if self._true is not None:
            self._true_qpos[:] = q
            self._true.forward(stage=stage)
            np.subtract(gravity, self._true_bias, out=self.missing)


def _entries(model: Any) -> tuple[Index, Index]:
    """Return (row, column) of every entry of MuJoCo's sparse inertia `M`."""
    count = np.asarray(model.M_rownnz)
    rows = np.repeat(np.arange(model.nv), count)
    return rows, np.asarray(model.M_colind)[: len(rows)]


@compiled
def _spread(entries: Array, rows: Index, columns: Index, rotor: Array, mass: Array) -> None:
    """Write the inertias (N, n, n) of MuJoCo's sparse entries (N, E), rotors (n,) added."""
    for i in range(len(mass)):
        for k in range(len(rows)):
            mass[i, rows[k], columns[k]] = mass[i, columns[k], rows[k]] = entries[i, k]
        for j in range(len(rotor)):
            mass[i, j, j] += rotor[j]


class GTERig:
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
        belief: Arm | None = None,
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
            belief: the controller's own model of the arm, None for the true one.
            scatter: whether iterations differ by pose, friction and dither phase.
            seed: of that scatter.
            parameters: friction of one arm or of each simulation, None for the model's.
            nthread: threads, 0 for all processors.
        """
        self.plant = Plant(sticking, nsim, parameters=parameters, nthread=nthread, closed_loop=True)
        self.protocol, self.approach, self.interface = protocol, approach, interface
        self.motion, self.start, self.scatter, self.seed = motion, np.array(start), scatter, seed
        self.nsim, self.n = nsim, sticking.n
        self.flange = EndEffector(sticking, self.plant.batch)
        arm = sticking.arm
        self._belief = Belief(belief or arm, sticking, nsim, nthread, coriolis=settings.coriolis)
        self.controller = CartesianImpedance(settings, nsim, arm.limits)
        self.keeper = GoalKeeper(nsim, motion, capacity)
        self._path = TorquePath(interface, nsim, self.n)
        self._hold = approach.hold_stiffness * arm.limits.torque
        inertia = link_inertia(arm, self.start[None])[0] + sticking.parameters.rotor_inertia
        self._hold_damping = 2 * approach.hold_damping_ratio * np.sqrt(self._hold * inertia)
        self._goal_period = round(1.0 / (motion.publish_rate_hz * CONTROL_DT))
        self._model_period = protocol.model_steps
        self.dither = Dither.none(nsim, self.n)
        self.phase = np.zeros((nsim, self.n))
        """(N, n) phase drawn for the dither of this iteration [rad]."""
        self.dither_seed = np.zeros(nsim, dtype=np.uint64)
        """(N,) seed drawn for the waveform ``random``."""
        self.step = np.zeros(nsim, dtype=np.int64)
        """(N,) control steps since the arm began to follow."""
        self.start_position, self.start_quaternion = self._nominal()
        self._watch: Callable[[], None] | None = None
        self._count, self._hold_steps = 0, interface.hold_steps
        self._arguments: tuple[Any, ...] = ()
        self._nothing = np.zeros((nsim, self.n))
        self.applied = np.zeros((nsim, self.n))
        """(N, n) torque that reached the joints in the last control step, overwritten [N·m]."""
        self._torque = np.zeros((nsim, self.n))
        self.shaking = np.zeros((nsim, self.n))
        """(N, n) dither torque of the last controller cycle, overwritten by the next [N·m]."""

    def _nominal(self) -> tuple[Array, Array]:
        """Return the flange pose (3,), (4,) at the start angles."""
        self.plant.reset(np.arange(self.nsim), np.broadcast_to(self.start, (self.nsim, self.n)))
        self.flange.read()
        return self.flange.position[0].copy(), self.flange.quaternion[0].copy()

    def begin(
        self, ids: Index, paths: Sequence[Path], stiffness: Array, keys: Sequence[tuple[int, ...]]
    ) -> None:
        """Bring arms to the start, against their friction, and give them their goals.

        Args:
            ids: (M,) sorted simulations.
            paths: of each, all with the same number of goals or fewer than the capacity.
            stiffness: (M, 3) translational, rotational, nullspace.
            keys: seed the scatter of each.
        """
        p, m = self.approach, len(ids)
        target = np.tile(self.start, (m, 1))
        origin = target.copy()
        factor = np.ones((m, self.n))
        self.phase[ids], self.dither_seed[ids] = 0.0, 0
        for row, (i, key) in enumerate(zip(ids, keys, strict=True)):
            rng = np.random.default_rng([self.seed, *key])
            # the arm comes back from where the path was: from any side
            side = rng.choice([-1.0, 1.0], size=self.n) if self.scatter else 1.0
            origin[row] += self.protocol.return_distance * side
            if self.scatter:
                shift = np.clip(p.pose_scatter * rng.normal(size=self.n), -0.05, 0.05)
                target[row] += shift
                factor[row] += np.clip(p.friction_scatter * rng.normal(size=self.n), -0.5, 0.5)
                self.phase[i] = rng.uniform(0, 2 * np.pi, size=self.n)
                self.dither_seed[i] = rng.integers(2**32)
        low, high = self.plant.sticking.arm.limits.position.T
        self.plant.reset(ids, np.clip(origin, low, high))
        self.plant.scale_friction(ids, factor)
        damping = np.tile(self._hold_damping, (m, 1))
        self.plant.set_servo(ids, np.tile(self._hold, (m, 1)), damping, origin)
        steps = round((p.return_time + p.settle_time) / CONTROL_DT)
        x = np.clip(np.arange(steps) * CONTROL_DT / p.return_time, 0.0, 1.0)
        x = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        moves = origin[:, None] + x[:, None] * (target - origin)[:, None]
        self.plant.run(np.zeros((m, steps, self.n)), ids, setpoint=moves)
        zero = np.zeros((m, self.n))
        self.plant.set_servo(ids, zero, zero, target)
        self.plant.refresh(ids)
        self._hand_over(ids, paths, stiffness)

    def _hand_over(self, ids: Index, paths: Sequence[Path], stiffness: Array) -> None:
        """Let the controller take the arms from where they stand."""
        self.flange.read()
        x, quaternion = self.flange.position[ids], self.flange.quaternion[ids]
        q = self.plant.position
        self.controller.set_stiffness(
            ids,
            translational=stiffness[:, 0],
            rotational=stiffness[:, 1],
            nullspace=stiffness[:, 2],
        )
        # after the stiffness: its filter starts settled
        self.controller.reset(ids, x, quaternion, q[ids])
        self._belief.update(q, self.plant.velocity)
        self.controller.update_model(ids, self.flange.jacobian[ids], self._belief.mass[ids])
        self._path.reset(ids)
        self.step[ids] = 0
        for row, i in enumerate(ids):
            here = np.array([i])
            goals, turns = paths[row].goals(self.start_position[None], self.start_quaternion[None])
            self.keeper.start(here, goals, turns, x[row : row + 1], quaternion[row : row + 1], 0.0)

    def set_dither(
        self,
        ids: Index,
        *,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        waveform: ArrayLike = DEFAULT_WAVEFORM,
        offset: ArrayLike = 0.0,
        gate_velocity: ArrayLike = np.inf,
        phase: ArrayLike = 0.0,
        drawn: ArrayLike = True,
    ) -> None:
        """Set the dither of arms ``ids``, all (M, n).

        Where ``drawn``, the phase drawn for the iteration is added to ``phase``; the others are as
        in `dither.Dither`.
        """
        shape = (len(ids), self.n)
        mine = Dither(
            amplitude=np.broadcast_to(amplitude, shape),
            frequency=frequency,
            waveform=waveform,
            offset=offset,
            gate_velocity=gate_velocity,
            phase=np.asarray(phase) + np.where(drawn, self.phase[ids], 0.0),
            seed=self.dither_seed[ids],
        )
        self.dither = self.dither.set_rows(ids, mine)

    def retune(self, amplitude: Array, frequency: Array) -> None:
        """Change A [N·m] and f [Hz] of all arms (N, n), keeping each phase continuous."""
        self.dither = self.dither.retune(
            self._time(),
            amplitude=amplitude,
            frequency=frequency,
        )

    def advance(self, steps: int, watch: Callable[[], None] | None = None) -> None:
        """Follow for ``steps`` control steps; ``watch`` is called in each, before the arms move."""
        self._watch, self._count = watch, int(self.step.max())
        self._arguments = self._step_arguments()
        self.plant.follow(self._law, steps)

    def _time(self) -> Array:
        """Return (N,) time since the arm began to follow [s]."""
        return np.multiply(self.step, CONTROL_DT, dtype=np.float64)

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
        flange, t = self.flange, self._time()
        flange.read()
        if model:
            self._belief.update(self.plant.position, self.plant.velocity)
            self.controller.update_model(None, flange.jacobian, self._belief.mass)
        if goals:
            self.keeper.accept(flange.position, flange.quaternion, t)
            position, quaternion, _, _ = self.keeper.reference(t)
            self.controller.set_reference(position, quaternion)

    def _control_step(self, due: bool) -> None:
        if due:
            self.controller.advance_filters()
            if self.dither.sines is None:
                speed = self.plant.velocity if self.dither.gated else None
                self.shaking[:] = self.dither.torque(self._time(), speed)
        control_step(due, *self._arguments)

    def _step_arguments(self) -> tuple[Any, ...]:
        """Return those of `control_step` that stay the same objects while arms follow."""
        sticking, belief, dither = self.plant.sticking, self._belief, self.dither
        sines = dither.sines or (self._nothing, self._nothing, dither.amplitude)
        return (
            self.flange.arguments,
            (*self.plant.state, sticking.motor, sticking.spring),
            (dither.sines is not None, *sines),
            self.step,
            # zero where it is not asked for
            (belief.coriolis, self._nothing),
            self.controller.arguments,
            self._path.arguments,
            belief.missing,
            self.shaking,
            self.applied,
            self._torque,
        )
