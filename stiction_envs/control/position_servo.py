"""Position servos of N simulations: the path of a command to the servo.

    command --delay--> speed limit --> dead zone --> K (r − q), limited --> joint, under gravity

K, delay and limits are those of `PositionServos`; the servo's damping is the joint's (``viscous``
of the friction).
"""

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.servos import PositionServos
from stiction_envs.plant import CONTROL_DT, Plant

DEAD_STEPS = 5
"""Control steps for which a dead zone is held [-]: a servo's own cycle is longer; assumed."""


def put_under_servos(sticking: StickingModel, servos: PositionServos) -> None:
    """Let gravity act on a model that was just built, and limit its servos' torque."""
    sticking.model.body_gravcomp[:] = 0.0
    limit = np.stack([-servos.torque_limit, servos.torque_limit], axis=1)
    sticking.model.actuator_forcerange[sticking.servo_actuator] = limit


class ServoDrive:
    """The servos of N simulations on their way through commands."""

    def __init__(self, servos: PositionServos, plant: Plant) -> None:
        """Make the servos of a plant whose model is one of `put_under_servos`."""
        self.servos, self.plant = servos, plant
        steps = np.maximum(servos.delay, 0.0) / CONTROL_DT
        self._whole = np.floor(steps).astype(np.int64)
        self._part = steps - self._whole
        self._past = int(self._whole.max()) + 1
        # the last commands, and what the servos followed last
        self._commands = np.zeros((plant.nsim, self._past, plant.n))
        self._followed = np.zeros((plant.nsim, plant.n))

    def reset(self, ids: Index, command: Array) -> None:
        """Let simulations ``ids`` start with constant past commands ``command`` (M, n) [rad]."""
        self._commands[ids], self._followed[ids] = command[:, None], command
        stiffness = np.broadcast_to(self.servos.stiffness, command.shape)
        self.plant.set_servo(ids, stiffness, np.zeros_like(stiffness), command)

    @property
    def command(self) -> Array:
        """(N, n) last command of each simulation [rad]."""
        return self._commands[:, -1].copy()

    def weight(self, ids: Index) -> Array:
        """Return (M, n) the torque that balances simulations ``ids`` where they are [N·m]."""
        signed, _ = self.plant.load
        signed = np.where(self.plant.sticking.bearing, 0.0, signed)
        return (signed + self.plant.offset)[ids]

    def run(self, command: Array, ids: Index, *, joint: Index | None = None) -> Array:
        """Advance simulations under commands (M, K, n) [rad]; as `Plant.run` otherwise."""
        setpoint = self._reach(command, ids)
        dead = self.servos.dead_zone
        steps = setpoint.shape[1]
        part = DEAD_STEPS if dead.any() else steps
        shape = (len(ids), steps) if joint is not None else setpoint.shape
        out, none = np.empty(shape), np.zeros((len(ids), part, self.plant.n))
        for k in range(0, steps, part):
            here = setpoint[:, k : k + part]
            if dead.any():
                error = here - self.plant.motor_position[ids][:, None]
                here = here - np.clip(error, -dead, dead)
            m = here.shape[1]
            out[:, k : k + m] = self.plant.run(none[:, :m], ids, setpoint=here, joint=joint)
        return out

    def _reach(self, command: Array, ids: Index) -> Array:
        """Return the commands that servos follow (M, K, n) [rad]: late, and limited in speed."""
        seen = np.concatenate([self._commands[ids], command], axis=1)
        self._commands[ids] = seen[:, -self._past :]
        steps = command.shape[1]
        out = np.empty_like(command)
        for j, (whole, part) in enumerate(zip(self._whole, self._part, strict=True)):
            first = self._past - int(whole)
            now, before = seen[:, first : first + steps, j], seen[:, first - 1 :, j][:, :steps]
            out[:, :, j] = (1.0 - part) * now + part * before
        followed = self._followed[ids]
        _limit_speed(out, followed, self.servos.speed_limit * CONTROL_DT)
        self._followed[ids] = followed
        return out


@compiled
def _limit_speed(values: Array, last: Array, most: Array) -> None:
    """Limit the change of values (M, K, n) per step to ``most`` (n,), from ``last`` (M, n)."""
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            for j in range(values.shape[2]):
                change = min(most[j], max(-most[j], values[i, k, j] - last[i, j]))
                last[i, j] += change
                values[i, k, j] = last[i, j]
