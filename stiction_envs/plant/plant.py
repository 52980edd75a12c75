"""N sticking arms in lockstep.

One `Plant` runs N simulations of one sticking model on `mujoco.batch.Batch`. Each simulation has
its own joints' friction, pose, torque and servo. Results are the same bits for any number of
simulations and threads: every operation here is element by element, and a simulation has its
own clock.

Friction is native (`friction.model`). What MuJoCo's LuGre lacks is written here as parameters:

* load, warm-up and offset, which change over tenths of a second, every `SLOW_STEPS` control steps;
* direction, which changes within one, every control step – only if some level depends on it.
"""

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.friction.load_sensor import load_sensor, read_loads
from stiction_envs.friction.model import BRISTLE_DAMPING, RIPPLE, StickingModel
from stiction_envs.friction.parameters import CONTROL_DT, QUANTITIES, FrictionParameters
from stiction_envs.plant.copies import CopiedBatch
from stiction_envs.plant.loop_arrays import (
    SLOW_STEPS,
    FrictionArrays,
    PlantArrays,
    write_friction,
)
from stiction_envs.plant.loop_batch import Loop, LoopBatch
from stiction_envs.robots.stated import BRISTLE_STIFFNESS


class Plant:
    """N simulations of one sticking arm, stepped in blocks of control steps of 1 ms."""

    def __init__(
        self,
        sticking: StickingModel,
        nsim: int,
        *,
        parameters: FrictionParameters | None = None,
        threads: int = 0,
        closed_loop: bool = False,
    ) -> None:
        """Make the simulations; all rest at the arm's rest pose with servos off.

        Args:
            sticking: the model.
            nsim: number of simulations N ≥ 1.
            parameters: friction of one arm (n,) or of each (N, n); None takes the model's.
            threads: threads, 0 for all processors.
            closed_loop: whether compiled code steps the simulations (`loop_batch`).
        """
        if nsim < 1:
            raise StictionError(f"number of simulations {nsim}: allowed are 1 and more")
        self.sticking = sticking
        self.nsim, self.n = nsim, sticking.n
        self._substeps = round(CONTROL_DT / sticking.timestep)
        kind = LoopBatch if closed_loop else CopiedBatch
        self.batch: CopiedBatch = kind(sticking.model, nsim, threads)
        """The engine's batch, to render from; stepping it elsewhere breaks the clocks."""
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._ctrl = self.batch.bind("ctrl")
        # the model adds them in two contiguous groups; slices are several times faster
        self._torque_columns = slice(sticking.torque_actuator[0], sticking.torque_actuator[-1] + 1)
        self._servo_columns = slice(sticking.servo_actuator[0], sticking.servo_actuator[-1] + 1)
        self._setpoint = np.zeros((nsim, self.n))
        base = sticking.parameters if parameters is None else parameters
        tiled = base.tile(nsim) if base.rotor_inertia.ndim == 1 else base
        self._p = {k: np.array(getattr(tiled, k), order="C") for k in QUANTITIES}
        self.arrays = self._make_arrays()
        """Arrays of compiled code; always the same objects."""
        self.reset(np.arange(nsim), np.broadcast_to(sticking.arm.rest, (nsim, self.n)))
        self.set_friction(np.arange(nsim), tiled)

    @property
    def position(self) -> Array:
        """(N, n) link angles [rad]."""
        return self.sticking.link_position(self._qpos)

    @property
    def velocity(self) -> Array:
        """(N, n) link speeds [rad/s]."""
        return self.sticking.link_position(self._qvel)

    @property
    def state(self) -> tuple[Array, Array]:
        """Live (N, nq) MuJoCo positions [rad] and (N, nv) speeds [rad/s]."""
        return self._qpos, self._qvel

    @property
    def motor_position(self) -> Array:
        """(N, n) motor-side angles [rad]; equal to the link's where the joint is rigid."""
        return self._qpos[:, self.sticking.motor]

    @property
    def bristle(self) -> Array:
        """(N, n) LuGre bristle deflections z [rad]."""
        adr = self.sticking.model.actuator_actadr[self.sticking.torque_actuator]
        return self.batch.bind("act")[:, adr]

    @property
    def load(self) -> tuple[Array, Array]:
        """(signed, absolute) transmitted torque, each (N, n) [N·m]; see `friction.load_sensor`."""
        signed = read_loads(np.arange(self.nsim), self.arrays.load)
        return signed, np.abs(signed)

    @property
    def offset(self) -> Array:
        """(N, n) torque that balances the arm beyond its gravity compensation [N·m]."""
        p = self.arrays.friction
        return np.asarray(
            p.offset + p.gravity_error * np.clip(self.load[0], -p.load_high, p.load_high)
        )

    @property
    def stiction(self) -> Array:
        """(N, n) stiction at the present load, mean of the directions [N·m]."""
        return self.arrays.level.mean(axis=2)

    @property
    def loop_batch(self) -> LoopBatch:
        """The batch of a plant that is ``closed_loop``, which compiled code steps."""
        assert isinstance(self.batch, LoopBatch)
        return self.batch

    def reset(self, ids: Index, q: ArrayLike) -> None:
        """Put simulations ``ids`` at rest at link angles q (M, n) [rad], friction relaxed."""
        q = np.asarray(q, float)
        limits = self.sticking.arm.limits.position
        if np.any((q < limits[:, 0]) | (q > limits[:, 1])) or not np.all(np.isfinite(q)):
            bad = np.argwhere(~((q >= limits[:, 0]) & (q <= limits[:, 1])))[0][-1]
            raise StictionError(
                f"joint {bad + 1}: start angle outside [{limits[bad, 0]}, {limits[bad, 1]}] rad"
            )
        if len(ids) == 0:
            return
        self.batch.reset(ids, stage=0)
        qpos = np.zeros((len(ids), self.sticking.model.nq))
        qpos[:, self.sticking.motor] = q
        self._qpos[ids] = qpos
        self._setpoint[ids] = q
        self.arrays.steps[ids] = 0
        self.arrays.moving_up[ids] = True
        self.batch.forward(ids)
        write_friction(np.asarray(ids), 1, self.arrays)

    def refresh(self, ids: Index) -> None:
        """Make the engine's kinematics of simulations ``ids`` those of the present state."""
        self.batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_VEL)

    def set_friction(self, ids: Index, parameters: FrictionParameters) -> None:
        """Give simulations ``ids`` their own friction, fields (M, n) or (M, n, 2)."""
        s = self.sticking
        if not np.array_equal(parameters.elastic, s.parameters.elastic):
            raise StictionError("which joints are elastic is fixed when the model is built")
        sigma1 = s.bristle_damping_of(parameters)
        for name in QUANTITIES:
            self._p[name][ids] = getattr(parameters, name)
        act, rotor = s.torque_actuator, np.asarray(parameters.rotor_inertia)
        rows = np.asarray(ids)[:, None]
        self._write("actuator_dynprm", ids, (act, BRISTLE_STIFFNESS), parameters.bristle_stiffness)
        self._write("actuator_dynprm", ids, (act, BRISTLE_DAMPING), sigma1)
        bias = self.arrays.bias
        bias[rows, act, RIPPLE] = parameters.ripple_amplitude
        bias[rows, act, RIPPLE + 1] = parameters.ripple_periods
        bias[rows, act, RIPPLE + 2] = parameters.ripple_phase
        self._write("dof_armature", ids, (s.motor,), rotor)
        elastic = s.spring >= 0
        if elastic.any():
            stiffness = parameters.joint_stiffness[:, elastic]
            ratio = parameters.joint_damping_ratio[:, elastic]
            joints = s.model.dof_jntid[s.spring[elastic]]
            # with one coefficient MuJoCo keeps stiffness and damping as plain arrays
            self._write("jnt_stiffness", ids, (joints,), stiffness)
            self.arrays.damping[rows, s.spring[elastic]] = (
                2 * ratio * np.sqrt(stiffness * rotor[:, elastic])
            )
        self.arrays.asymmetric[:] = FrictionParameters(**self._p).asymmetric
        write_friction(np.asarray(ids), 1, self.arrays)

    def _write(self, name: str, ids: Index, where: tuple[Index | int, ...], values: Array) -> None:
        """Write a model field of simulations ``ids`` at indices ``where``: (M, n) values.

        The engine copies what simulations have of their own in every step: a field in which they
        do not differ from the model stays the model's.
        """
        shared = getattr(self.sticking.model, name)[where]
        if self.batch.expanded(name) is None and np.all(values == shared):
            return
        self.batch.expand(name)[(np.asarray(ids)[:, None], *where)] = values

    def scale_friction(self, ids: Index, factor: Array) -> None:
        """Multiply the dry friction of simulations ``ids`` by ``factor`` (M, n) [-]."""
        self.arrays.factor[ids] = factor
        write_friction(np.asarray(ids), 1, self.arrays)

    def set_servo(
        self, ids: Index, stiffness: ArrayLike, damping: ArrayLike, setpoint: ArrayLike
    ) -> None:
        """Hold joints of simulations ``ids`` (M,) natively, on the motor side.

        Stiffness [N·m/rad], 0 for a free joint, damping [N·m·s/rad] and setpoint [rad] are (M, n).
        """
        rows, act = np.asarray(ids)[:, None], self.sticking.servo_actuator
        self.batch.expand("actuator_gainprm")[rows, act, 0] = stiffness
        self.arrays.bias[rows, act, 1] = -np.asarray(stiffness)
        self.arrays.bias[rows, act, 2] = -np.asarray(damping)
        self._setpoint[ids] = setpoint

    def run(
        self,
        torque: Array,
        ids: Index | None = None,
        *,
        setpoint: Array | None = None,
        joint: Index | None = None,
    ) -> Array:
        """Advance simulations by K control steps of 1 ms.

        Args:
            torque: (M, K, n) torque on the joints [N·m], held for one control step each.
            ids: (M,) sorted simulations, None for all N.
            setpoint: (M, K, n) servo setpoints [rad]; None keeps those of `set_servo`.
            joint: (M,) the one joint (from 0) to report of each simulation; None reports all.

        Returns:
            (M, K, n) link angles after each control step [rad], or (M, K) of the one joint.

        Raises:
            ExperimentError: a simulation that the engine stopped (NaN, divergence).
        """
        ids = np.arange(self.nsim) if ids is None else np.asarray(ids)
        m, k_total, _ = torque.shape
        s = self.sticking
        control = np.empty((m, k_total, s.model.nu))
        control[:, :, self._torque_columns] = torque
        control[:, :, self._servo_columns] = (
            self._setpoint[ids][:, None] if setpoint is None else setpoint
        )
        if setpoint is not None:
            self._setpoint[ids] = setpoint[:, -1]
        out = np.empty((m, k_total) if joint is not None else (m, k_total, self.n))
        k = 0
        while k < k_total:
            write_friction(ids, SLOW_STEPS, self.arrays)
            left = SLOW_STEPS - int((self.arrays.steps[ids] % SLOW_STEPS).max())
            block = 1 if self.arrays.asymmetric[0] else left
            block = min(block, k_total - k)  # no simulation passes its next update
            part = control[:, k : k + block]
            if self._substeps > 1:
                part = np.repeat(part, self._substeps, axis=1)
            qpos = self.batch.rollout(
                block * self._substeps, control=part, record=("qpos",), ids=ids
            )["qpos"]
            qpos = qpos[:, self._substeps - 1 :: self._substeps]
            q = s.link_position(qpos)
            out[:, k : k + block] = q if joint is None else q[np.arange(m), :, joint]
            self.arrays.steps[ids] += block
            k += block
        raise_if_stopped(self.batch)
        return out

    def _make_arrays(self) -> PlantArrays:
        s, batch, nsim, first = self.sticking, self.batch, self.nsim, self.batch.state.ctypes.data
        torque = self._ctrl[:, self._torque_columns]
        return PlantArrays(
            state=batch.state,
            qpos=(self._qpos.ctypes.data - first) // 8,
            qvel=(self._qvel.ctypes.data - first) // 8,
            torque=(torque.ctypes.data - first) // 8,
            motor=s.motor,
            spring=s.spring,
            substeps=self._substeps,
            asymmetric=np.zeros(1, dtype=bool),
            steps=np.zeros(nsim, dtype=np.int64),
            load=load_sensor(s, batch),
            friction=FrictionArrays(*(self._p[name] for name in FrictionArrays._fields)),
            factor=np.ones((nsim, self.n)),
            actuator=s.torque_actuator,
            moving_up=np.ones((nsim, self.n), dtype=bool),
            level=np.empty((nsim, self.n, 2)),
            viscous=np.empty((nsim, self.n, 2)),
            applied=batch.bind("qfrc_applied"),
            bias=batch.expand("actuator_biasprm"),
            damping=batch.expand("dof_damping"),
        )

    def loops(self) -> list[tuple[int, int, Loop]]:
        """Return first arm, end and arguments of `loop_batch.advance` of each part of the arms.

        Their servos hold as set. Check the batch by `raise_if_stopped` when all are done.
        """
        self._ctrl[:, self._servo_columns] = self._setpoint
        batch = self.loop_batch
        parts = zip(batch.parts, batch.loops, strict=True)
        return [(part.start, part.stop, loop) for part, loop in parts]


def raise_if_stopped(batch: Batch) -> None:
    """Raise if the engine stopped a simulation: its records then repeat, as if it stood still."""
    count = batch.warning[:, :, 1]
    if count.any():
        sim, kind = np.argwhere(count)[0]
        name = mujoco.mjtWarning(int(kind)).name
        raise ExperimentError(f"simulation {sim} stopped by the engine: {name}")
