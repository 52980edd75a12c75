"""The path of a torque command: held by the controller, rate-limited, low-passed, clipped.

    command (+ dither) --hold--> rate limit --> first-order low-pass --> torque limit --> joint

as on the Panda (libfranka 0.9: sources.md 1.8). Dither is added to the command before all of it,
as in the thesis (3.2). Everything works on blocks of K control steps of 1 ms for M simulations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.kernels import pass_torques
from stiction_envs.errors import StictionError
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
CONTROL_RATE_HZ = 1000  # control steps of a simulation per second [Hz] (sources.md 1.8)


@dataclass(frozen=True, kw_only=True)
class TorqueInterface:
    """Rate, filter and limits with which a robot processes torque commands."""

    controller_rate_hz: int
    """Rate at which the controller computes; its output is held in between [Hz]."""
    lowpass_hz: float
    """Cut-off of the first-order low-pass [Hz]; 0 is off."""
    torque_rate: Array
    """(n,) largest change of torque [N·m/s]; inf is off."""
    torque_limit: Array
    """(n,) largest torque [N·m]."""

    def __post_init__(self) -> None:
        rate = self.controller_rate_hz
        if not 1 <= rate <= CONTROL_RATE_HZ or rate != int(rate) or CONTROL_RATE_HZ % int(rate):
            raise StictionError(
                f"controller rate {rate} Hz: expected one of the divisors of {CONTROL_RATE_HZ} Hz"
            )
        if not 0 <= self.lowpass_hz < np.inf:
            raise StictionError(f"low-pass {self.lowpass_hz} Hz: expected 0 (off) or above")

    @classmethod
    def of(
        cls, arm: Arm, *, controller_rate_hz: float | None = None, lowpass_hz: float | None = None
    ) -> TorqueInterface:
        """Return the interface of an arm, with the rate or the filter replaced where given."""
        rate = arm.controller_rate_hz if controller_rate_hz is None else controller_rate_hz
        return cls(
            controller_rate_hz=int(rate) if float(rate).is_integer() else rate,  # type: ignore[arg-type]
            lowpass_hz=arm.lowpass_hz if lowpass_hz is None else lowpass_hz,
            torque_rate=arm.limits.torque_rate,
            torque_limit=arm.limits.torque,
        )

    def unlimited(self) -> TorqueInterface:
        """Return the same rate without filter and limits."""
        far = np.full_like(self.torque_limit, np.inf)
        return replace(self, lowpass_hz=0.0, torque_rate=far, torque_limit=far)

    @property
    def hold_steps(self) -> int:
        """Control steps for which one command is held."""
        return CONTROL_RATE_HZ // int(self.controller_rate_hz)

    @property
    def lowpass_gain(self) -> float:
        """The g of y ← y + g(u − y): Δt/(Δt + 1/(2πf_c)), sources.md 1.8; 1 is off [-]."""
        if self.lowpass_hz == 0:
            return 1.0
        dt = 1.0 / CONTROL_RATE_HZ
        return dt / (dt + 1.0 / (2 * np.pi * self.lowpass_hz))

    def tick(self, step: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the control step at which the command held at ``step`` was computed."""
        hold = self.hold_steps
        return (step // hold) * hold


class TorquePath:
    """State of the path for N simulations of n joints."""

    def __init__(self, interface: TorqueInterface, nsim: int, n: int) -> None:
        self.interface = interface
        self._limited = np.zeros((nsim, n))
        self._filtered = np.zeros((nsim, n))
        self._rate = np.full((nsim, n), np.inf)
        self._step = self._rate / CONTROL_RATE_HZ
        self._limit = np.full((nsim, n), np.inf)
        if n == len(interface.torque_limit):
            self.set_limits(np.arange(nsim), interface.torque_rate, interface.torque_limit)

    def set_limits(self, ids: NDArray[np.int64], torque_rate: Array, torque_limit: Array) -> None:
        """Set the limits of simulations ``ids``: (n,) or (M, n), N·m/s and N·m.

        For arms whose columns are not always the same joints.
        """
        self._rate[ids] = torque_rate
        self._step = self._rate / CONTROL_RATE_HZ
        self._limit[ids] = torque_limit

    def reset(self, ids: NDArray[np.int64], torque: Array | float = 0.0) -> None:
        """Start simulations ``ids`` as if ``torque`` (M, n) [N·m] had been held for long."""
        self._limited[ids] = torque
        self._filtered[ids] = torque

    def run(self, command: Array, ids: NDArray[np.int64]) -> Array:
        """Pass a block of commands.

        Args:
            command: (M, K, n) [N·m], one per control step of 1 ms, already held.
            ids: (M,) the simulations.

        Returns:
            (M, K, n) torque that reaches the joints [N·m].
        """
        out = np.empty_like(command)
        limited, filtered = self._limited[ids], self._filtered[ids]
        gain = self.interface.lowpass_gain
        pass_torques(command, self._step[ids], gain, self._limit[ids], limited, filtered, out)
        self._limited[ids], self._filtered[ids] = limited, filtered
        return out

    @property
    def arguments(self) -> tuple[Array, float, Array, Array, Array]:
        """All of `kernels.pass_torque` between the command and the result, until `set_limits`."""
        gain = self.interface.lowpass_gain
        return self._step, gain, self._limit, self._limited, self._filtered
