"""The Single Joint Experiment on joints that are driven by position servos.

The arm is held by its own servos under gravity. The command of the joint under test moves away
slowly: its torque K (command − angle) grows by the protocol's ramp rate while the joint sticks.
Dither is a sine on that command, of amplitude A/K [rad] where the job says A [N·m]. The joint does
not run away, it follows: its breakaway torque is the largest that the servo puts on it beyond
gravity until it has moved by the threshold, averaged over the dither.
"""

from collections.abc import Sequence

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.control.position_servo import ServoDrive
from stiction_envs.experiments.poses import Poses
from stiction_envs.experiments.rig import Experiment, minimum_jerk
from stiction_envs.experiments.sje.protocol import Configuration, Protocol
from stiction_envs.experiments.sje.rig import HIGHPASS, RAMP, SJERig
from stiction_envs.friction.servos import PositionServos
from stiction_envs.plant import CONTROL_DT

FURTHER = 2.0
"""Way of a command, over the threshold, after which a joint that stays counts as stuck [-];
assumed."""


class ServoRig(SJERig):
    """N simulations of the experiment under position servos."""

    def __init__(
        self,
        experiment: Experiment,
        nsim: int,
        protocol: Protocol,
        poses: Poses,
        servos: PositionServos,
    ) -> None:
        """Make the rig; see `SJERig`. The experiment's model is one of `put_under_servos`."""
        super().__init__(experiment, nsim, protocol, poses)
        self.drive = ServoDrive(servos, self.plant)
        self._servos.torque_limit = np.array(servos.torque_limit)
        self._sag = np.zeros((nsim, self.n))  # of the pose [rad]
        self._weight = np.zeros((nsim, 2))  # of the joint: at its ramp's start, and last [N·m]
        self._lead = np.zeros((nsim, 3))  # of `_largest_lead`

    def place(self, ids: Index, configurations: Sequence[Configuration]) -> None:
        """See `SJERig`; commands hold the arm against gravity.

        Joints come from where their ramps lead: coming from behind, friction would hold a part of
        the ramp's torque before the ramp.
        """
        stiffness = self.drive.servos.stiffness
        at = np.array([(c.index[0], c.index[1]) for c in configurations])
        self.plant.reset(ids, self.poses.q[at[:, 0], at[:, 1]])
        self._sag[ids] = self.drive.weight(ids) / stiffness
        super().place(ids, configurations)
        self._hold[ids], self._hold_damping[ids] = stiffness, 0.0
        start = self.pose[ids].copy()
        start[np.arange(len(ids)), at[:, 0]] += self.sign[ids] * self.protocol.threshold
        self.plant.reset(ids, start)
        self.drive.reset(ids, self.plant.motor_position[ids] + self.drive.weight(ids) / stiffness)

    def approach(self, ids: Index, keys: Sequence[tuple[int, ...]]) -> None:
        """See `SJERig`; commands start from where they are."""
        super().approach(ids, keys)
        self._origin[ids] = self.drive.command[ids]

    def _setpoints(self, ids: Index, step: Index, ramping: Bools) -> Array:
        x = np.where(ramping[:, None], 1.0, minimum_jerk(step / self._move_steps))[:, :, None]
        origin, target = self._origin[ids][:, None], (self.target + self._sag)[ids][:, None]
        return (1.0 - x) * origin + x * target

    def _drive(
        self, torque: Array, ids: Index, setpoint: Array | None, joint: Index | None
    ) -> Array:
        assert setpoint is not None
        rows = np.flatnonzero(self.stage[ids] == RAMP)
        added = torque[rows]
        added[np.arange(len(rows)), :, self.joint[ids[rows]]] -= self.start_torque[ids[rows], None]
        command = setpoint.copy()
        command[rows] += added / self.drive.servos.stiffness
        return self.drive.run(command, ids, joint=joint)

    def _tolerance(self, ids: Index) -> Array:
        """Return (M, n) the protocol's, and where friction lets a servo stop short."""
        signed, load = self.plant.load
        short = self._servos.resistance(signed[ids], load[ids]) / self.drive.servos.stiffness
        return self.protocol.start_tolerance + short + self.drive.servos.dead_zone

    def _release(self, ids: Index, joint: Index, offset: Array) -> None:
        """Note the torque of the servos beyond gravity; they go on holding all joints."""
        rows, servos = np.arange(len(ids)), self.drive.servos
        error = (self.drive.command - self.plant.motor_position)[ids]
        error -= np.clip(error, -servos.dead_zone, servos.dead_zone)
        weight = self.drive.weight(ids)
        self.start_torque[ids] = (servos.stiffness * error - weight)[rows, joint]
        # the command has to move by the threshold too, and gravity changes on the way
        self._give_up[ids] += FURTHER * servos.stiffness[joint] * self.protocol.threshold
        self._weight[ids] = weight[rows, joint][:, None]
        self._lead[ids] = (self.sign * self.start_torque)[ids][:, None]

    def _torque_at(self, ids: Index, torque: Array, angle: Array, last: Index) -> Array:
        """Return (M,) the largest torque beyond gravity until steps ``last`` (M,) [N·m]."""
        rows, joint = np.arange(len(ids)), self.joint[ids]
        weight = self.drive.weight(ids)[rows, joint]
        start, before = self._weight[ids].T
        share = (np.arange(torque.shape[1]) + 1) / torque.shape[1]
        grown = (before - start)[:, None] + share * (weight - before)[:, None]
        moved = angle - self.start_angle[ids][:, None]
        stiffness = self.drive.servos.stiffness[joint]
        lead = self.sign[ids][:, None] * (torque - stiffness[:, None] * moved - grown)
        mine = self.dither.frequency[ids, joint]
        shaken = self.dither.amplitude[ids].any(axis=1)
        gain = np.ones(len(ids))
        x = 2 * np.pi * HIGHPASS * mine[shaken] * CONTROL_DT
        gain[shaken] = x / (1.0 + x)
        state = self._lead[ids]
        _largest_lead(lead, last, gain, state)
        self._lead[ids], self._weight[ids, 1] = state, weight
        return self.sign[ids] * state[:, 2]


@compiled
def _largest_lead(lead: Array, last: Index, gain: Array, state: Array) -> None:
    """Keep the largest of torques ``lead`` (M, K) [N·m] behind two low-passes of first order.

    Steps count up to ``last`` (M,); ``gain`` (M,) is each filter's, 1 for none. ``state`` (M, 3),
    updated, is the torque behind the first, behind both, and the largest [N·m].
    """
    for i in range(lead.shape[0]):
        for k in range(last[i] + 1):
            state[i, 0] += gain[i] * (lead[i, k] - state[i, 0])
            state[i, 1] += gain[i] * (state[i, 0] - state[i, 1])
            state[i, 2] = max(state[i, 2], state[i, 1])
