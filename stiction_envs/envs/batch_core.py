"""What the environments' cores share: spaces, actions, episodes that end, the next observation.

A core is N slots of one environment. The single environment has one slot, the vector environment
one per environment; `skin.py` makes both from a core. Nothing in a core may depend on how many
slots there are: row i of a batch and a single environment with the same random generator are the
same bits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from stiction_envs.envs.sje_layout import Group, observation_bounds, observation_names
from stiction_envs.errors import StictionError
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]
_ROUNDING = 1e-5  # of an action's range: what float32 and RescaleAction may be off by


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What one step of M slots gave; arrays (M,)."""

    reward: Array
    terms: dict[str, Array]
    """Per name of the core's `terms`; they sum to the reward."""
    terminated: Bools
    truncated: Bools


class Slots(ABC):
    """N slots of an environment whose action is amplitudes and frequencies of all joints."""

    terms: ClassVar[tuple[str, ...]]
    """Terms of the reward, in the order in which they are summed."""
    each: ClassVar[tuple[str, ...]]
    """Fields of the outcome that are in the info of every step."""
    final: ClassVar[tuple[str, ...]]
    """Fields of the outcome that are in the info of an episode's last step."""

    def __init__(
        self,
        num_envs: int,
        arm: Arm,
        *,
        groups: Sequence[Group],
        low: Array,
        high: Array,
        interval: float,
        max_episode_steps: int,
    ) -> None:
        """Make the spaces.

        Args:
            num_envs: number of slots N.
            arm: of n joints.
            groups: the observation.
            low: (2n,) lowest action [N·m, Hz].
            high: (2n,) highest action.
            interval: time of a step [s].
            max_episode_steps: steps after which an episode is truncated.
        """
        self.arm, self.n, self.num_envs = arm, arm.n, num_envs
        self.interval, self.max_episode_steps = interval, int(max_episode_steps)
        self._groups = groups
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = Box(*observation_bounds(arm.n, groups), dtype=np.float32)
        self.observation_names = observation_names(arm.n, groups)
        self._low = self.action_space.low.astype(float)
        self._high = self.action_space.high.astype(float)
        self.action = np.zeros((num_envs, 2 * arm.n))
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self.alive = np.zeros(num_envs, dtype=bool)

    @abstractmethod
    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Mapping[str, Any] | None],
    ) -> None:
        """Start an episode in slots ``ids``, each drawn from its own generator."""

    @abstractmethod
    def step(self, ids: Index, action: Any) -> Any:
        """Dither slots ``ids`` with ``action`` (M, 2n) for one interval; return an `Outcome`."""

    @abstractmethod
    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of slots ``ids``: a fresh array."""

    @abstractmethod
    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return what the episodes of slots ``ids`` are, by name of the info: fresh arrays."""

    # ---- what the cores use ------------------------------------------------------------------

    def _need_alive(self, ids: Index) -> None:
        if not np.all(self.alive[ids]):
            raise StictionError("step: the episode is over or was never started: call reset")

    def _check_action(self, action: Any, m: int) -> Array:
        """Return the action as float64 within the space."""
        try:
            out = np.array(action, dtype=float)
        except (TypeError, ValueError):
            raise StictionError(f"action is a {type(action).__name__}: numbers expected") from None
        shape = (m, 2 * self.n)
        if out.shape != shape:
            raise StictionError(f"action has shape {out.shape}: allowed is {shape}")
        slack = _ROUNDING * (self._high - self._low)
        good = (out >= self._low - slack) & (out <= self._high + slack)
        if not good.all():
            row, k = np.argwhere(~good)[0]
            what, unit = ("amplitude", "N·m") if k < self.n else ("frequency", "Hz")
            raise StictionError(
                f"action: {what} of joint {k % self.n + 1} is {out[row, k]:g} {unit}: allowed are "
                f"{self._low[k]:g} to {self._high[k]:g} {unit}"
            )
        return np.clip(out, self._low, self._high)

    def _loads(self, action: Array) -> tuple[Array, Array]:
        """Return mean over joints of (A / A_max)² and of the dither's (2πfA)², each (M,)."""
        amplitude, frequency = action[:, : self.n], action[:, self.n :]
        rate = 2 * np.pi * frequency * amplitude / self.arm.limits.torque_rate
        top = self._high[: self.n]
        return np.mean((amplitude / top) ** 2, axis=1), np.mean(rate**2, axis=1)

    def _sum(self, terms: Mapping[str, Array]) -> Array:
        reward = np.zeros(len(terms[self.terms[0]]))
        for name in self.terms:
            reward = reward + terms[name]
        return reward

    def _scaled(self, ids: Index) -> tuple[Array, Array]:
        """Return the last amplitudes and frequencies, (M, n) each, in [-1, 1]."""
        scaled = 2.0 * (self.action[ids] - self._low) / (self._high - self._low) - 1.0
        return scaled[:, : self.n], scaled[:, self.n :]

    def _pack(self, values: Mapping[str, Array], m: int) -> NDArray[np.float32]:
        """Return observations (m, observations) of values by name of the group."""
        columns = [values[g.name].reshape(m, -1) for g in self._groups]
        space = self.observation_space
        return np.clip(np.concatenate(columns, axis=1), space.low, space.high).astype(np.float32)


def check_arguments(max_episode_steps: Any, **weights: float) -> None:
    """Raise a StictionError for a weight below 0, or a number of steps that is not one."""
    for name, value in weights.items():
        if not 0 <= value < np.inf:
            raise StictionError(f"{name} {value}: allowed are 0 and above")
    if not isinstance(max_episode_steps, (int, np.integer)) or max_episode_steps < 1:
        raise StictionError(
            f"max_episode_steps {max_episode_steps}: allowed are whole numbers from 1"
        )


def count_blocks(interval: float, block: float) -> int:
    """Return how many blocks [s] a control interval [s] has.

    Raises:
        StictionError: not a whole number of them.
    """
    blocks = round(interval / block) if np.isfinite(interval) else 0
    if blocks < 1 or abs(blocks * block - interval) > 1e-9:
        raise StictionError(
            f"control_interval_s {interval}: allowed are the multiples of {block:g} s"
        )
    return blocks
