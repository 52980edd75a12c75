"""Simulator of the Single Joint Experiment: N arms, each at its point of the protocol.

    approach (servos bring the arm to the pose) -> ramp (the joint under test is free, its torque
    grows) -> threshold: idle

Friction is never reset between one ramp and the next: the arm is moved back (thesis 3.2).
"""

from collections.abc import Callable, Sequence

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.dither.dither import add_sines
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.poses import Poses
from stiction_envs.experiments.rig import Experiment, Rig, minimum_jerk
from stiction_envs.experiments.sje.protocol import Configuration, Protocol
from stiction_envs.plant import CONTROL_DT, SLOW_STEPS

IDLE, APPROACH, RAMP = 0, 1, 2
BLOCK = SLOW_STEPS  # Control steps of one `advance`
STICKING = 0.2
"""A joint still sticks until it has moved by this part of the threshold [-]; assumed: past it the
joint runs away, and its speed is no longer the dither's."""
HIGHPASS = 0.2
"""Corner over the dither's frequency of the high-pass that removes creep from the speed [-];
assumed: it takes 2 % of the oscillation."""


class SJERig(Rig):
    """N simulations of the experiment on one plant."""

    def __init__(self, experiment: Experiment, nsim: int, protocol: Protocol, poses: Poses) -> None:
        """Make the rig; all ``nsim`` simulations are idle."""
        super().__init__(experiment, nsim, approach=protocol)
        self.protocol, self.poses = protocol, poses
        # of every pose, joint by joint, load before no load
        self._inertia = self._servos.inertia(poses.q.reshape(-1, self.n))
        self._hold = np.zeros((nsim, self.n))
        self._hold_damping = np.zeros((nsim, self.n))
        self.dither_seed[:] = self.seed
        self.stage = np.full(nsim, IDLE)
        """(N,) what each simulation is doing: `IDLE`, `APPROACH` or `RAMP`."""
        self.joint = np.zeros(nsim, dtype=np.int64)
        self.sign = np.ones(nsim)
        self.target = np.zeros((nsim, self.n))
        self.pose = np.zeros((nsim, self.n))
        self.start_torque = np.zeros(nsim)
        self.start_angle = np.zeros(nsim)
        self.noise = np.zeros(nsim)
        self.tau = np.full(nsim, np.nan)
        self.shaken_speed = np.zeros(nsim)
        """(N,) root mean square speed of the joint under test before it broke away, without what is
        slow against the dither [rad/s]."""
        self._speeds = np.zeros((nsim, 4))  # of `_add_squares`
        self._read_speed = np.zeros((nsim, self.n))
        self.watch: Callable[[Index, Array], None] | None = None
        """Called with each block of ramps: simulations (M,), angles (M, K, n) [rad]."""
        self._origin = np.zeros((nsim, self.n))
        self._torque_noise = np.zeros(nsim)
        self._give_up = np.zeros(nsim)
        self._approach_steps = round((protocol.return_time + protocol.settle_time) / CONTROL_DT)
        self._approach_steps = -(-self._approach_steps // BLOCK) * BLOCK
        self._move_steps = max(1, round(protocol.return_time / CONTROL_DT))
        # control steps in which no command changes
        self._cycle = 1 if BLOCK % self.interface.hold_steps else self.interface.hold_steps

    def place(self, ids: Index, configurations: Sequence[Configuration]) -> None:
        """Put arms into new configurations, displaced as after a ramp in the other direction."""
        joint = np.array([c.joint - 1 for c in configurations])
        load = np.array([c.index[1] for c in configurations])
        self.joint[ids], self.sign[ids] = joint, [c.sign for c in configurations]
        self.pose[ids] = self.poses.q[joint, load]
        start = self.pose[ids].copy()
        start[np.arange(len(ids)), joint] -= self.sign[ids] * self.protocol.threshold
        self.plant.reset(ids, start)
        here = (x[2 * joint + load] for x in self._inertia)
        self._hold[ids], self._hold_damping[ids] = self._servos_of(ids, *here)
        self.stage[ids] = IDLE

    def approach(self, ids: Index, keys: Sequence[tuple[int, ...]]) -> None:
        """Move arms back to their pose; ``keys`` seed the scatter of this iteration."""
        p = self.protocol
        self._origin[ids] = self.plant.motor_position[ids]
        self._seed_senses(ids, keys)
        target, factor = self.pose[ids].copy(), np.ones((len(ids), self.n))
        for row, (i, key) in enumerate(zip(ids, keys, strict=True)):
            self.dither_phase[i], self.noise[i], self._torque_noise[i] = 0.0, 0.0, 0.0
            if self.scatter:
                rng = np.random.default_rng([self.seed, *key])
                shift, factor[row] = self._draw_pose_and_friction(rng)
                target[row] += shift
                self.noise[i] = p.torque_noise * rng.normal()
                samples = max(1.0, p.averaging_time / CONTROL_DT)
                self._torque_noise[i] = p.torque_noise * rng.normal() / np.sqrt(samples)
                self._draw_dither(i, rng)
        self.target[ids] = target
        self.plant.scale_friction(ids, factor)
        self.plant.set_servo(ids, self._hold[ids], self._hold_damping[ids], self._origin[ids])
        self.stage[ids], self.step[ids] = APPROACH, 0
        self.tau[ids] = np.nan

    def displacement(self) -> Array:
        """Return (N,) angle of the joint under test since its ramp started, as measured [rad]."""
        q = self.seen_position[np.arange(self.nsim), self.joint]
        return q - self.start_angle

    @property
    def holding_torque(self) -> Array:
        """(N, n) torque with which servos hold joints, as if none were free [N·m]."""
        lag = self.target - self.plant.motor_position
        speed = self.plant.state[1][:, self.plant.sticking.motor]
        return self._hold * lag - self._hold_damping * speed

    def ramp_torque(self, ids: Index, step: Index) -> Array:
        """Return (M, K) commanded torque without dither [N·m] at control steps (M, K) of a ramp."""
        rate = self.sign[ids] * self.protocol.ramp_rate * CONTROL_DT
        return self.start_torque[ids][:, None] + rate[:, None] * self.interface.tick(step)

    def advance(self, ids: Index) -> Index:
        """Advance busy simulations ``ids`` (sorted) by a block; return those whose ramp ended.

        One that ended is idle; ``tau`` holds its torque [N·m], NaN if it was given up as stuck.
        """
        m = len(ids)
        ramping = self.stage[ids] == RAMP
        step = self.step[ids][:, None] + np.arange(BLOCK)
        rows = np.flatnonzero(ramping)
        ramps, ramp_step = ids[rows], step[rows]
        ramp = self.ramp_torque(ramps, ramp_step)
        setpoint = self._setpoints(ids, step, ramping)
        joint = self.joint[ids]
        angle = np.empty((m, BLOCK + 1))
        angle[:, 0] = self.plant.position[ids, joint]
        every = self.watch is not None or self.senses is not None
        seen = np.empty((m, BLOCK, self.n)) if every else None
        measured = np.empty((len(rows), BLOCK, self.n)) if self.senses is not None else None
        part = self._cycle if self.dither.gated else BLOCK
        for k in range(0, BLOCK, part):
            here = slice(k, k + part)
            torque = np.zeros((m, part, self.n))
            if len(rows):
                torque[rows] = self._command(ramps, ramp_step[:, here], ramp[:, here], k)
            moved_to = None if setpoint is None else setpoint[:, here]
            only = joint if seen is None else None
            found = self._drive(torque, ids, moved_to, only)
            if seen is not None:
                seen[:, here] = found
                if self.senses is not None and measured is not None:
                    after = ramp_step[:, here] + 1
                    measured[:, here] = self.senses.read_block(ramps, after, found[rows])
                found = found[np.arange(m), :, joint]
            angle[:, 1 + k : 1 + k + part] = found
        self.step[ids] += BLOCK
        self._start_ramps(ids[~ramping])
        if not len(rows):
            return ids[:0]
        # speeds count while the joint is still near where it stuck
        corner = HIGHPASS * self.dither.frequency[ramps, joint[rows]]
        gain, far = 1 / (1 + 2 * np.pi * corner * CONTROL_DT), STICKING * self.protocol.threshold
        sums = self._speeds[ramps]
        _add_squares(angle[rows], self.start_angle[ramps], far, gain, sums)
        self._speeds[ramps] = sums
        if self.watch is not None and seen is not None:
            self.watch(ramps, seen[rows])
        last = angle[rows, 1:]
        if measured is not None:
            last = measured[np.arange(len(rows)), :, joint[rows]]
        return self._finish(ramps, ramp, last)

    def _drive(
        self, torque: Array, ids: Index, setpoint: Array | None, joint: Index | None
    ) -> Array:
        """Advance the plant under torques (M, K, n) [N·m], servos at setpoints (M, K, n) [rad]."""
        return self.plant.run(torque, ids, setpoint=setpoint, joint=joint)

    def _command(self, ids: Index, step: Index, ramp: Array, ahead: int) -> Array:
        """Return the torque (M, K, n) [N·m] behind the torque path of ``ramp`` (M, K) and dither.

        ``ahead`` control steps of the block came before these.
        """
        length = step.shape[1]
        command = np.zeros((len(ids), length, self.n))
        command[np.arange(len(ids)), :, self.joint[ids]] = ramp
        if self.dither.sines is not None:
            time = np.multiply(self.interface.tick(step), CONTROL_DT, dtype=np.float64)
            add_sines(*self.dither.sines, time, ids, command)
        elif self.dither.amplitude.any() or self.dither.offset.any():
            speed = self._gate_speed()
            if speed is not None:  # each controller has the speed that it read in its last cycle
                due = ids[step[:, 0] % self.interface.hold_steps == 0]
                self._read_speed[due] = speed[due]
                speed = self._read_speed
            for k in range(0, length, self._cycle):
                shaken = self.dither.torque(self._command_time(ahead + k), speed)[ids]
                command[:, k : k + self._cycle] += shaken[:, None]
        if self.senses is not None:
            self.senses.send_block(ids, step, command)
        return self._path.run(command, ids)

    def _setpoints(self, ids: Index, step: Index, ramping: Bools) -> Array | None:
        """Return (M, K, n) setpoints [rad] of a minimum-jerk move back; None where all are held."""
        if ramping.all():
            return None
        x = np.where(ramping[:, None], 1.0, minimum_jerk(step / self._move_steps))
        origin, target = self._origin[ids][:, None], self.target[ids][:, None]
        return origin + x[:, :, None] * (target - origin)

    def _start_ramps(self, ids: Index) -> None:
        """Free the joint of arms whose approach is over, and note where the ramp starts."""
        ids = ids[self.step[ids] >= self._approach_steps]
        if not len(ids):
            return
        p = self.protocol
        at_rest = np.abs(self.plant.velocity[ids]).max(axis=1) < p.rest_speed
        ids = ids[at_rest | (self.step[ids] >= p.patience * self._approach_steps)]
        if not len(ids):
            return
        rows, joint = np.arange(len(ids)), self.joint[ids]
        q = self.plant.position[ids]
        missed = np.abs(q - self.pose[ids]) - self._tolerance(ids)
        if missed.max() > 0:
            i, j = np.unravel_index(missed.argmax(), q.shape)
            signed, load = self.plant.load
            resists = self._servos.resistance(signed[ids], load[ids])[i, j]
            limit = self._servos.torque_limit[j]
            raise ExperimentError(
                f"joint {j + 1} stopped {q[i, j] - self.pose[ids[i], j]:+.3f} rad from its pose: "
                f"expected at most {self._tolerance(ids)[i, j]:.3g} rad; held with "
                f"{self._hold[ids[i], j]:.3g} N·m/rad and at most {limit:.3g} N·m against "
                f"{resists:.3g} N·m: change its friction, limits.torque in the arm's "
                "TOML, or hold_stiffness of the protocol"
            )
        self._rest_senses(ids)
        self.start_angle[ids] = self.seen_position[ids, joint]
        offset = self.plant.offset[ids][rows, joint]
        stiction = self.plant.stiction[ids][rows, joint]
        self._give_up[ids] = p.give_up_factor * (stiction + np.abs(offset))
        self._release(ids, joint, offset)
        start = np.zeros((len(ids), self.n))
        start[rows, joint] = self.start_torque[ids]
        self._path.reset(ids, start)
        if self.senses is not None:
            self.senses.hold(ids, start)
        self.stage[ids], self.step[ids] = RAMP, 0
        self._speeds[ids] = 0.0

    def _tolerance(self, ids: Index) -> Array:
        """Return (M, n) the largest distance from the pose when a ramp starts [rad]."""
        return np.full((len(ids), self.n), float(self.protocol.start_tolerance))

    def _release(self, ids: Index, joint: Index, offset: Array) -> None:
        """Free the joints (M,) under test, and note the torque at which their ramps start."""
        rows, averaged = np.arange(len(ids)), offset + self._torque_noise[ids]
        self.start_torque[ids] = averaged if self.protocol.averaged_start_torque else 0.0
        stiffness, damping = self._hold[ids], self._hold_damping[ids]
        stiffness[rows, joint] = damping[rows, joint] = 0.0
        self.plant.set_servo(ids, stiffness, damping, self.target[ids])

    def _finish(self, ids: Index, torque: Array, angle: Array) -> Index:
        """Record ramps that reached the threshold or were given up; return their simulations.

        ``torque`` (M, K) is the command's without dither [N·m], ``angle`` (M, K) the joint's [rad].
        """
        moved = self.sign[ids][:, None] * (angle - self.start_angle[ids][:, None])
        over = np.greater_equal(moved, self.protocol.threshold)
        reached: Bools = np.any(over, axis=1)
        first = over.argmax(axis=1)
        stuck = ~reached & (np.abs(torque[:, -1] - self.start_torque[ids]) > self._give_up[ids])
        done = np.flatnonzero(reached | stuck)
        tau = self._torque_at(ids, torque, angle, np.where(reached, first, over.shape[1] - 1))
        if not len(done):
            return done
        ended = ids[done]
        self.tau[ended] = np.where(reached[done], tau[done] + self.noise[ended], np.nan)
        squares, counted = self._speeds[ended, :2].T
        self.shaken_speed[ended] = np.sqrt(squares / np.maximum(counted, 1.0))
        self.stage[ended] = IDLE
        return ended

    def _torque_at(self, ids: Index, torque: Array, angle: Array, last: Index) -> Array:
        """Return (M,) the torque of ramps at steps ``last`` (M,) of this block [N·m].

        ``torque`` (M, K) is the command's without dither [N·m], ``angle`` (M, K) the joint's [rad].
        """
        return torque[np.arange(len(ids)), last]


@compiled
def _add_squares(angle: Array, start: Array, far: float, gain: Array, sums: Array) -> None:
    """Add the squares of high-passed speeds (first order) until a joint is ``far`` away [rad].

    Angles are (M, K + 1) [rad], the first of before, ``start`` (M,) where the ramp started [rad],
    ``gain`` (M,) the filter's. ``sums`` (M, 4), updated, are sum of squares [rad²/s²], number,
    speed and filtered speed [rad/s].
    """
    for i in range(angle.shape[0]):
        for k in range(1, angle.shape[1]):
            speed = (angle[i, k] - angle[i, k - 1]) / CONTROL_DT
            sums[i, 3] = gain[i] * (sums[i, 3] + speed - sums[i, 2])
            sums[i, 2] = speed
            if abs(angle[i, k] - start[i]) < far:
                sums[i, 0] += sums[i, 3] * sums[i, 3]
                sums[i, 1] += 1.0
