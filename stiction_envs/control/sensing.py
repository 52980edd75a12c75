"""Sensor errors, delays and lost cycles of the controllers of N arms.

    joints --lag of the logged speed--> delay --noise--> resolution --> q, dq
    command --some cycles lost--> delay --> torque path

Sensors are read, and commands sent, once per controller cycle; in between both are held. The speed
is the robot's own, which lags (a filter of first order), or the difference of the angles that were
read, over a cycle, behind a low-pass. *Ideal* is none of this, and computes nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.arrays import Array, Index
from stiction_envs.control.sensing_kernels import (
    Measured,
    Sent,
    begin_arm,
    send_block,
    sense_block,
)
from stiction_envs.control.torque_path import low_pass_gain
from stiction_envs.errors import StictionError
from stiction_envs.method_settings import Amount, check_fields, override
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm
from stiction_envs.robots.arm_toml import read_toml
from stiction_envs.robots.registry import ARMS

LONGEST = 0.1  # Longest delay or lag that is simulated [s]; assumed
Amounts = Amount | tuple[Amount, ...]  # One number for all joints, or one per joint
Time = Annotated[float, msgspec.Meta(ge=0, le=LONGEST)]


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """Senses of one arm. SI units; what ends in "per joint" is one number, or one per joint."""

    speed: Literal["logged", "difference"] = "logged"
    """The robot's own speed, or the difference of the angles that were read."""
    angle_resolution: Amounts = 0.0  # Step of the angles read, per joint [rad]
    angle_noise: Amounts = 0.0  # Standard deviation of white noise on them, per joint [rad]
    speed_lag: Time | tuple[Time, ...] = 0.0
    """Time constant of the filter of first order behind which the robot logs its speed, per joint
    [s]."""
    speed_noise: Amounts = 0.0
    """Standard deviation of white noise on a logged speed, per joint [rad/s]."""
    speed_cutoff: Amount = 0.0
    """Corner of the low-pass of first order behind the difference of angles [Hz]; 0 is none."""
    measurement_delay: Time = 0.0  # Age of what is read [s]
    command_delay: Time = 0.0  # Time until a command acts [s]
    missed_cycles: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.0
    """Share of cycles whose command is lost: the one before is held [-]."""

    def __post_init__(self) -> None:
        check_fields(self, "sensing")

    @property
    def is_ideal(self) -> bool:
        """True if no error is simulated, so nothing is computed."""
        return self == Sensing()

    def of_joint(self, name: str, n: int) -> Array:
        """Return the numbers (n,) of a field; raise a StictionError for another count of joints."""
        value = np.asarray(getattr(self, name))
        if value.ndim and len(value) != n:
            raise StictionError(f"sensing {name} of {len(value)} joints: expected {n}, or one")
        return np.array(np.broadcast_to(value, (n,)))

    def check(self, n: int) -> None:
        """Raise a StictionError unless every field is one number, or one for each of n joints."""
        for field in fields(self):
            if isinstance(getattr(self, field.name), tuple):
                self.of_joint(field.name, n)


SensingLike = str | Path | Sensing
"""``ideal``, ``robot``, a TOML with a table ``[sensing]``, or senses."""


def load_sensing(arm: Arm, what: SensingLike = "ideal") -> Sensing:
    """Return the senses of an arm.

    Args:
        arm: the arm.
        what: ``ideal``; ``robot``, those of the registered arm's own TOML; a TOML with a table
            ``[sensing]``, whose entries are fields of `Sensing`, plain or ``{value = …}``; senses.

    Raises:
        StictionError: an arm without known senses, an unreadable file, or a bad field.
    """
    if isinstance(what, Sensing):
        what.check(arm.n)
        return what
    if not isinstance(what, str | Path):
        raise StictionError(f"sensing {what!r}: expected ideal, robot, a TOML or Sensing")
    if str(what) == "ideal":
        return Sensing()
    where = Path(what)
    if str(what) == "robot":
        own = {name: files.table for name, files in ARMS.items() if "sensing" in files.table}
        if arm.registered_name not in own:
            raise StictionError(
                f"sensing robot: {arm.name} has no table [sensing], only {', '.join(own)}: "
                "expected ideal, or a TOML with a table [sensing]"
            )
        where, table = ARMS[arm.registered_name].toml, own[arm.registered_name]
    elif not where.is_file():
        raise StictionError(f"sensing {what}: expected ideal, robot, or an existing TOML")
    else:
        table = read_toml(where)
    if not isinstance(table.get("sensing"), Mapping):
        raise StictionError(f"{where}: expected a table [sensing]")
    try:
        out = override(Sensing(), table["sensing"])
        out.check(arm.n)
    except StictionError as error:
        raise StictionError(f"{where}: {error}") from None
    return out


def _steps(seconds: float) -> float:
    """Return a time in control steps, without the error of 0.003 / 0.001."""
    return round(seconds / CONTROL_DT, 9)


def _room(seconds: float) -> int:
    """Return how many control steps the past of a delay needs."""
    return int(np.ceil(_steps(seconds))) + 2


class Senses:
    """Sensors of N arms of n joints, read once per controller cycle, and the way of its commands.

    Of the commands some cycles are lost, then comes a delay.
    """

    def __init__(self, sensing: Sensing, nsim: int, n: int, *, hold_steps: int = 1) -> None:
        """Make the sensors of N arms of n joints; each arm needs `reset`.

        ``hold_steps`` are the control steps of a controller cycle.
        """
        sensing.check(n)
        self.sensing, self._hold = sensing, hold_steps
        s, cycle = sensing, hold_steps * CONTROL_DT
        seed = np.zeros(nsim, dtype=np.uint64)
        self.q, self.dq = np.zeros((2, nsim, n))
        """(N, n) what the controller has: angles [rad], speeds [rad/s]."""
        lag = s.of_joint("speed_lag", n) if s.speed == "logged" else np.zeros(n)
        noise = s.of_joint("speed_noise", n) if s.speed == "logged" else np.zeros(n)
        self.arrays = Measured(
            speed_by_difference=s.speed == "difference",
            cycle=cycle,
            speed_gain=low_pass_gain(s.speed_cutoff, cycle),
            delay=_steps(s.measurement_delay),
            # delays slow motion by exactly the lag
            lag_gain=CONTROL_DT / (CONTROL_DT + lag),
            angle_noise=s.of_joint("angle_noise", n),
            angle_resolution=s.of_joint("angle_resolution", n),
            speed_noise=noise,
            seed=seed,
            past=np.zeros((nsim, _room(s.measurement_delay), 2, n)),
            q=self.q,
            dq=self.dq,
        )
        self.sent = Sent(
            missed=s.missed_cycles,
            delay=_steps(s.command_delay),
            seed=seed,
            held=np.zeros((nsim, n)),
            past=np.zeros((nsim, _room(s.command_delay), n)),
            arrived=np.zeros((nsim, n)),
        )
        """Both are arrays of compiled functions, always the same objects; ``arrived`` (N, n) is
        what acts since the last command arrived [N·m]."""

    def reset(self, ids: Index, q: Array, seeds: ArrayLike) -> None:
        """Let arms ``ids`` have rested at q (M, n) [rad] for long: averaged, without torque.

        ``seeds`` (M,) are whole numbers below 2⁶⁴, from which noise and lost cycles are drawn.
        """
        self.arrays.seed[ids] = np.asarray(seeds, dtype=np.uint64)
        for row, i in enumerate(ids):
            begin_arm(i, q[row], self.arrays)
        self.hold(ids, 0.0)

    def hold(self, ids: Index, torque: Array | float) -> None:
        """Let ``torque`` (M, n) [N·m] have been commanded to arms ``ids`` for long."""
        self.sent.held[ids] = self.sent.arrived[ids] = torque
        self.sent.past[ids] = self.sent.held[ids][:, None]

    def read_block(self, ids: Index, step: Index, q: Array) -> Array:
        """Return the angles (M, K, n) [rad] that controllers have after sensors read true angles q.

        ``step`` (M, K) are numbers of successive control steps of arms ``ids`` (M,).
        """
        seen = np.empty_like(q)
        sense_block(ids, step, self._hold, CONTROL_DT, q, self.arrays, seen)
        return seen

    def send_block(self, ids: Index, step: Index, command: Array) -> None:
        """Replace commands (M, K, n) [N·m] of arms ``ids`` at steps (M, K) by what arrives."""
        send_block(ids, step, self._hold, command, self.sent)


def seeds_of(seed: int, keys: Sequence[tuple[int, ...]]) -> NDArray[np.uint64]:
    """Return (M,) seeds of senses from an experiment's seed and the keys of its simulations."""
    words = [
        np.random.SeedSequence([seed, *key, _STREAM]).generate_state(1, np.uint64) for key in keys
    ]
    return np.concatenate(words) if words else np.zeros(0, dtype=np.uint64)


_STREAM = 0x53454E53  # "SENS": no other stream of an experiment ends on it
