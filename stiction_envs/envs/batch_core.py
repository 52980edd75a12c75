"""N simulations of one environment: spaces, actions, how episodes start, go on and end.

What an environment has of its own is in `sje_core.py` and `gte_core.py`. The single environment has
a core of one simulation, the vector environment of as many as it has; `gym_env.py` makes both.
Nothing in a core may depend on how many there are: row i of a batch and a single environment with
the same random generator are the same bits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from stiction_envs.envs.layout import (
    Group,
    action_bounds,
    observation_bounds,
    observation_names,
)
from stiction_envs.envs.randomise import check_spreads, draw, randomised, true_friction
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]
ScatterKey = tuple[int, ...]
"""Seed of the scatter of one episode."""
_ROUNDING = 1e-5  # of an action's range: what float32 and RescaleAction may be off by


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What one step of M simulations gave; arrays (M,)."""

    reward: Array
    terms: dict[str, Array]
    """Per name of the core's `terms`; they sum to the reward."""
    terminated: Bools
    truncated: Bools


class BatchCore(ABC):
    """N simulations of an environment that dithers all joints: amplitudes, then frequencies."""

    terms: ClassVar[tuple[str, ...]]
    """Terms of the reward, in the order in which they are summed."""
    each: ClassVar[tuple[str, ...]]
    """Fields of the outcome that are in the info of every step."""
    final: ClassVar[tuple[str, ...]]
    """Fields of the outcome that are in the info of an episode's last step."""
    arms_per_thread: ClassVar[int]
    """Arms of a tile per thread, measured by ``benchmarks/batch_size.py``: see `tiles.Tiles`."""

    stiction: Array
    """(n,) unit of the observed torques [N·m]."""
    speed_unit: float
    """Unit of the observed speeds [rad/s]."""
    rig: Any
    """The experiment's machine with all N arms."""

    def __init__(
        self,
        num_envs: int,
        experiment: SingleJointExperiment | GeneratedTrajectoryExperiment,
        *,
        poses: Poses,
        groups: Sequence[Group],
        interval: float,
        max_episode_steps: int,
        power_weight: float,
        torque_rate_weight: float,
        fixed_options: Mapping[str, Any] | None,
        randomise: Mapping[str, float] | None,
        friction_factor: float,
    ) -> None:
        """Make the spaces.

        Args:
            num_envs: number of simulations N.
            experiment: what is simulated.
            poses: whose loads decide the largest amplitudes.
            groups: the observation.
            interval: time of a step [s].
            max_episode_steps: steps after which an episode is truncated.
            power_weight: of that penalty [-].
            torque_rate_weight: of that penalty [-].
            fixed_options: reset options of all episodes.
            randomise: spreads of `randomise.FIELDS`.
            friction_factor: of true stiction and load coefficient over the nominal ones [-].
        """
        self._nominal = experiment.sticking.parameters
        self._true = true_friction(experiment.sticking, friction_factor)
        self._spreads = check_spreads(randomise, experiment.sticking)
        self.arm = arm = experiment.sticking.arm
        self.n, self.num_envs = arm.n, num_envs
        self.interval, self.max_episode_steps = interval, int(max_episode_steps)
        self.power_weight, self.torque_rate_weight = power_weight, torque_rate_weight
        self.fixed_options = self._check_options(fixed_options)
        low, high = action_bounds(experiment.sticking.parameters, poses, experiment.interface)
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = Box(*observation_bounds(arm.n, groups), dtype=np.float32)
        self.observation_names = observation_names(arm.n, groups)
        self._low = self.action_space.low.astype(float)
        self._high = self.action_space.high.astype(float)
        self.action = np.zeros((num_envs, 2 * arm.n))
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self.alive = np.zeros(num_envs, dtype=bool)

    # ---- what an environment has of its own --------------------------------------------------

    @abstractmethod
    def _check_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return valid reset options; a StictionError says what is wrong."""

    @abstractmethod
    def _draw(self, rng: np.random.Generator, options: Mapping[str, Any]) -> tuple[Any, ScatterKey]:
        """Return the case of an episode and the seed of its scatter.

        A generator gives the same number of draws whatever the options say.
        """

    @abstractmethod
    def _cases(self, options: Mapping[str, Any]) -> set[Any]:
        """Return every case that may be drawn with some options."""

    @abstractmethod
    def _undithered(self, cases: Sequence[Any]) -> Mapping[Any, Any]:
        """Return what cases are without dither: the unit of their rewards."""

    @abstractmethod
    def _begin(
        self, ids: Index, cases: Sequence[Any], keys: Sequence[ScatterKey], base: Any
    ) -> None:
        """Put simulations ``ids`` at the start of their cases, not dithered."""

    @abstractmethod
    def _advance(self, ids: Index) -> None:
        """Let simulations ``ids`` go on for one interval."""

    @abstractmethod
    def _outcome(self, ids: Index) -> Any:
        """Return the `Outcome` of the step that simulations ``ids`` have done."""

    @abstractmethod
    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""

    @abstractmethod
    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return what the episodes of ``ids`` are, by name of the info: fresh arrays."""

    # ---- episodes ----------------------------------------------------------------------------

    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Mapping[str, Any] | None],
    ) -> None:
        """Start an episode in simulations ``ids``, each drawn from its own generator.

        Raises:
            StictionError: an option that does not exist.
        """
        checked = self.check_reset(options)
        drawn = [self._draw(rng, o) for rng, o in zip(rngs, checked, strict=True)]
        cases, keys = [case for case, _ in drawn], [key for _, key in drawn]
        wanted = set(cases)
        if any(len(self._cases(o)) > 1 for o in checked):
            # further episodes will draw as well: one batch for all is the fastest
            wanted |= self._cases(self.fixed_options)
        base = self._undithered(sorted(wanted))
        if self._spreads:
            factors = np.stack([draw(rng, self.n) for rng in rngs])
            friction = randomised(self._true, self._spreads, factors)
            self.rig.plant.set_friction(ids, friction)
        elif self._true is not self._nominal:
            self.rig.plant.set_friction(ids, self._true.tile(len(ids)))
        self.action[ids] = self._low
        self._begin(ids, cases, keys, [base[case] for case in cases])
        self.steps[ids], self.alive[ids] = 0, True

    def step(self, ids: Index, action: Any) -> Any:
        """Dither simulations ``ids`` with ``action`` (M, 2n) [N·m, Hz] for one control interval.

        Returns:
            An `Outcome`.

        Raises:
            StictionError: an action outside the space, or an episode that is over.
        """
        self.action[ids] = self.check_step(ids, action)
        self.rig.retune(self.action[:, : self.n], self.action[:, self.n :])
        self._advance(ids)
        self.steps[ids] += 1
        return self._outcome(ids)

    def prepare(self, options: Sequence[Mapping[str, Any] | None]) -> None:
        """Find the units of the rewards of all that options may start, in one batch."""
        checked = self.check_reset(options)
        distinct = {repr(sorted(o.items())): o for o in checked}
        cases = set().union(*(self._cases(o) for o in distinct.values()))
        self._undithered(sorted(cases))

    def check_reset(self, options: Sequence[Mapping[str, Any] | None]) -> list[dict[str, Any]]:
        """Return the options of a reset, what is fixed included; nothing changes.

        Raises:
            StictionError: an option that does not exist.
        """
        return [{**self.fixed_options, **self._check_options(o)} for o in options]

    def check_step(self, ids: Index, action: Any) -> Array:
        """Return the action of a step as float64 within the space; nothing changes.

        Raises:
            StictionError: an action outside the space, or an episode that is over.
        """
        if not np.all(self.alive[ids]):
            raise StictionError("step: the episode is over or was never started: call reset")
        return self._check_action(action, len(ids))

    # ---- what the cores use ------------------------------------------------------------------

    def _check_action(self, action: Any, m: int) -> Array:
        """Return the action as float64 within the space."""
        try:
            out = np.array(action, dtype=float)
        except (TypeError, ValueError):
            raise StictionError(f"action is a {type(action).__name__}: numbers expected") from None
        shape = (m, 2 * self.n)
        if out.shape != shape:
            raise StictionError(f"action has shape {out.shape}: expected {shape}")
        slack = _ROUNDING * (self._high - self._low)
        good = (out >= self._low - slack) & (out <= self._high + slack)
        if not good.all():
            row, k = np.argwhere(~good)[0]
            what, unit = ("amplitude", "N·m") if k < self.n else ("frequency", "Hz")
            raise StictionError(
                f"action: {what} of joint {k % self.n + 1} is {out[row, k]:g} {unit}: expected "
                f"{self._low[k]:g} to {self._high[k]:g} {unit}"
            )
        return np.clip(out, self._low, self._high)

    def _penalties(self, ids: Index, share: Array) -> dict[str, Array]:
        """Return the penalties (M,) of the last action, in a step that is ``share`` (M,) of a run.

        They are the means over joints of (A / A_max)² and of the dither's (2πfA / limit)².
        """
        amplitude, frequency = self.action[ids, : self.n], self.action[ids, self.n :]
        rate = 2 * np.pi * frequency * amplitude / self.arm.limits.torque_rate
        top = self._high[: self.n]
        power, rates = np.mean((amplitude / top) ** 2, axis=1), np.mean(rate**2, axis=1)
        return {
            "power": -self.power_weight * share * power,
            "torque_rate": -self.torque_rate_weight * share * rates,
        }

    def _time(self, ids: Index) -> Array:
        """Return the time (M,) since the episodes of ``ids`` began [s]."""
        return np.asarray(self.rig.step[ids].astype(float) * CONTROL_DT)

    def _sum(self, terms: Mapping[str, Array]) -> Array:
        reward = np.zeros(len(terms[self.terms[0]]))
        for name in self.terms:
            reward = reward + terms[name]
        return reward


def weights_of(defaults: Any, **given: float | None) -> dict[str, float]:
    """Return weights of a reward by name: ``given``, or those of ``defaults`` where None.

    Raises:
        StictionError: a weight below 0.
    """
    out = {k: float(getattr(defaults, k)) if v is None else v for k, v in given.items()}
    for name, value in out.items():
        if not 0 <= value < np.inf:
            raise StictionError(f"{name} {value}: expected 0 or above")
    return out


def check_steps(max_episode_steps: Any) -> None:
    """Raise a StictionError for a number of steps that is not one."""
    if not isinstance(max_episode_steps, (int, np.integer)) or max_episode_steps < 1:
        raise StictionError(
            f"max_episode_steps {max_episode_steps}: expected a whole number from 1"
        )


def read_friction(
    friction: str | Path | FrictionParameters | None, n: int
) -> FrictionParameters | None:
    """Return the friction of an arm of ``n`` joints, read where it is a path."""
    return load_friction(Path(friction), n) if isinstance(friction, (str, Path)) else friction
