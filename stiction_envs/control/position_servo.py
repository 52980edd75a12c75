"""Joints driven by position servos: what a command passes through, for N simulations.

    command --delay--> speed limit --> dead zone --> K (r − q), limited --> joint, under gravity

K, delay and limits are those of the table ``[servo]`` that `stiction diagnose` writes of servo
logs; the servo's damping is the joint's (``viscous`` of the friction).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.robots.tables import read_toml

Array = NDArray[np.float64]
Index = NDArray[np.int64]
DEAD_STEPS = 5
"""Control steps for which a dead zone is held [-]: a servo's own cycle is longer; assumed."""
LONGEST_DELAY = 1.0
"""Longest delay of a command that is simulated [s]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionServos:
    """Position servos of one arm's joints."""

    stiffness: Array
    """(n,) K [N·m/rad]."""
    delay: Array
    """(n,) time until a command acts [s]; a negative one, of a log's clock, counts as none."""
    speed_limit: Array
    """(n,) largest speed of what the servo follows [rad/s]."""
    torque_limit: Array
    """(n,) [N·m]."""
    dead_zone: Array
    """(n,) error that the servo does not see [rad]."""

    def __post_init__(self) -> None:
        low = {"delay": -np.inf, "dead_zone": 0.0}
        for field in fields(self):
            value = np.array(getattr(self, field.name), dtype=np.float64)
            least = low.get(field.name)
            ok = np.isfinite(value) & (value > 0 if least is None else value >= least)
            if value.ndim != 1 or not ok.all() or (field.name == "delay" and (value > 1).any()):
                expected = {"delay": f"up to {LONGEST_DELAY:g} s", "dead_zone": "from 0"}
                raise StictionError(
                    f"servo {field.name} {value.tolist()}: expected numbers "
                    f"{expected.get(field.name, 'above 0')}, one per joint"
                )
            value.flags.writeable = False
            object.__setattr__(self, field.name, value)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.stiffness)


def read_servos(path: str | Path, n: int) -> PositionServos | None:
    """Return the servos of n joints in a friction TOML; None where it has no ``[servo]``.

    Raises:
        StictionError: unreadable, or a table that is not of n servos.
    """
    table = read_toml(Path(path)).get("servo")
    if table is None:
        return None
    names = [f.name for f in fields(PositionServos)]
    try:
        values = {name: np.array(table[name], dtype=np.float64) for name in names}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise StictionError(
            f"{path}: [servo] is not as stiction diagnose writes it: {error}"
        ) from None
    wrong = [name for name in names if values[name].shape != (n,)]
    if wrong:
        raise StictionError(f"{path}: [servo] {wrong[0]}: expected {n} numbers, one per joint")
    try:
        return PositionServos(**values)
    except StictionError as error:
        raise StictionError(f"{path}: {error}") from None


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
        """Let simulations ``ids`` have been told angles ``command`` (M, n) [rad] for long."""
        self._commands[ids], self._followed[ids] = command[:, None], command
        stiffness = np.broadcast_to(self.servos.stiffness, command.shape)
        self.plant.set_servo(ids, stiffness, np.zeros_like(stiffness), command)

    @property
    def command(self) -> Array:
        """(N, n) last command of each simulation [rad]."""
        out: Array = self._commands[:, -1].copy()
        return out

    def weight(self, ids: Index) -> Array:
        """Return (M, n) the torque that balances simulations ``ids`` where they are [N·m]."""
        signed, _ = self.plant.load
        signed = np.where(self.plant.sticking.bearing, 0.0, signed)
        out: Array = (signed + self.plant.offset)[ids]
        return out

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
        """Return what the servos follow (M, K, n) [rad]: late, and limited in speed."""
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
