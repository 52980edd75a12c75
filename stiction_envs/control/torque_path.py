"""The path of a torque command: held by the controller, rate-limited, low-passed, clipped.

    command (+ dither) --hold--> rate limit --> first-order low-pass --> torque limit --> joint

as on the Panda (libfranka 0.9: sources.md 1.8). Dither is added to the command before all of it,
as in the thesis (3.2). Everything works on blocks of K control steps of 1 ms for M simulations.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.impedance import between
from stiction_envs.errors import StictionError
from stiction_envs.method_settings import Amount, checked
from stiction_envs.robots import Arm

CONTROL_RATE_HZ = 1000  # control steps of a simulation per second [Hz] (sources.md 1.8)


@dataclass(frozen=True, kw_only=True)
class TorqueInterface:
    """Rate, filter and limits with which a robot processes torque commands."""

    controller_rate_hz: int  # Rate of the controller's cycles; between them its output is held [Hz]
    lowpass_hz: float  # Cut-off of the first-order low-pass [Hz]; 0 is off
    torque_rate: Array  # (n,) largest change of torque [N·m/s]; inf is off
    torque_limit: Array  # (n,) largest torque [N·m]

    def __post_init__(self) -> None:
        rate = self.controller_rate_hz
        if not 1 <= rate <= CONTROL_RATE_HZ or rate != int(rate) or CONTROL_RATE_HZ % int(rate):
            raise StictionError(
                f"controller rate {rate} Hz: expected one of the divisors of {CONTROL_RATE_HZ} Hz"
            )
        checked(self.lowpass_hz, Amount, "low-pass [Hz]")

    @classmethod
    def of(cls, arm: Arm) -> "TorqueInterface":
        """Return the interface of an arm."""
        rate = arm.controller_rate_hz
        return cls(
            controller_rate_hz=int(rate) if float(rate).is_integer() else rate,  # type: ignore[arg-type]
            lowpass_hz=arm.lowpass_hz,
            torque_rate=arm.limits.torque_rate,
            torque_limit=arm.limits.torque,
        )

    def unlimited(self) -> "TorqueInterface":
        """Return the same rate without filter and limits."""
        far = np.full_like(self.torque_limit, np.inf)
        return replace(self, lowpass_hz=0.0, torque_rate=far, torque_limit=far)

    @property
    def hold_steps(self) -> int:
        """Control steps for which one command is held."""
        return CONTROL_RATE_HZ // int(self.controller_rate_hz)

    @property
    def lowpass_gain(self) -> float:
        """Gain of the low-pass per control step; 1 is off [-]."""
        return low_pass_gain(self.lowpass_hz, 1.0 / CONTROL_RATE_HZ)

    def tick(self, step: Index) -> Index:
        """Return the control step at which the command held at ``step`` was computed."""
        hold = self.hold_steps
        return (step // hold) * hold


def low_pass_gain(cutoff_hz: float, dt: float) -> float:
    """Return the g of y ← y + g(u − y): Δt/(Δt + 1/(2πf_c)), sources.md 1.8; 1 for 0 Hz [-]."""
    return 1.0 if cutoff_hz == 0 else dt / (dt + 1.0 / (2 * np.pi * cutoff_hz))


class PathState(NamedTuple):
    """State of the path of N simulations of n joints."""

    step: Array  # (n,) largest change per control step [N·m]
    gain: float  # Gain of the low-pass; 1 is off [-]
    limit: Array  # (n,) [N·m]
    limited: Array  # (N, n) torque behind the rate limit, changed [N·m]
    filtered: Array  # (N, n) torque behind the low-pass, changed [N·m]


class TorquePath:
    """The path for N simulations of n joints."""

    def __init__(self, interface: TorqueInterface, nsim: int) -> None:
        n = len(interface.torque_limit)
        self.arrays = PathState(
            step=interface.torque_rate / CONTROL_RATE_HZ,
            gain=interface.lowpass_gain,
            limit=np.array(interface.torque_limit),
            limited=np.zeros((nsim, n)),
            filtered=np.zeros((nsim, n)),
        )
        """Arrays that `pass_torque` reads and writes; always the same objects."""

    def reset(self, ids: Index, torque: Array | float = 0.0) -> None:
        """Start simulations ``ids`` as if ``torque`` (M, n) [N·m] had been held for long."""
        self.arrays.limited[ids] = self.arrays.filtered[ids] = torque

    def run(self, command: Array, ids: Index) -> Array:
        """Return the torque (M, K, n) behind the path of held commands (M, K, n) [N·m]."""
        out = np.empty_like(command)
        _pass_block(ids, command, self.arrays, out)
        return out


@inlined
def pass_torque(i: int, command: Array, path: PathState, out: Array) -> None:
    """Write the torque of simulation ``i`` behind the path of its command, both (N, n) [N·m]."""
    for j in range(out.shape[1]):
        out[i, j] = _pass_one(i, j, command[i, j], path)


@inlined
def _pass_one(i: int, j: int, u: float, path: PathState) -> float:
    """Return the torque of one joint behind the path of a command u [N·m]."""
    step, limit = path.step[j], path.limit[j]
    # exactly the command wherever the rate allows it
    if not abs(u - path.limited[i, j]) <= 0.999 * step:
        u = between(u, path.limited[i, j] - step, path.limited[i, j] + step)
    path.limited[i, j] = u
    # added up as by scipy.signal.lfilter, bit for bit
    y = path.filtered[i, j] * (1.0 - path.gain) + u * path.gain if path.gain < 1.0 else u
    path.filtered[i, j] = y
    return between(y, -limit, limit)


@compiled
def _pass_block(ids: Index, command: Array, path: PathState, out: Array) -> None:
    for row in range(len(ids)):
        for k in range(command.shape[1]):
            for j in range(command.shape[2]):
                out[row, k, j] = _pass_one(ids[row], j, command[row, k, j], path)
